"""Services that save something, and always answer, even if saving fails."""

from __future__ import annotations

import logging
from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.printable import printable

logger = logging.getLogger(__name__)


def create_save_service(node: Node, name: str, what: str, save: Callable[[], str]) -> None:
    """Creates a service that saves something.

    Args:
        node: provides the service and the log.
        name: name of the service.
        what: what is saved, in one word, for the log.
        save: saves it and returns the response message; the message of an InputError is sent too.
    """

    def serve(_request: object, response: Trigger.Response) -> Trigger.Response:
        try:
            message = save()
            response.success = True
        except InputError as fault:
            message = str(fault)
        except Exception as error:
            # rclpy would send no response, and the client would wait for it
            logger.exception("The %s could not be saved", what)
            message = f"internal error: {type(error).__name__}: {error}; see the node's log"
        response.message = printable(message)
        node.get_logger().info(f"Saving the {what}: {response.message}")
        return response

    node.create_service(Trigger, name, serve)
