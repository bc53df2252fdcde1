"""Services that save something: they answer whatever becomes of it."""

from __future__ import annotations

import logging
from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.printable import printable

logger = logging.getLogger(__name__)


def create_save_service(node: Node, name: str, what: str, save: Callable[[], str]) -> None:
    """Offers to save something.

    Args:
        node: has the service and the log.
        name: of the service.
        what: what is saved, in a word.
        save: saves it, and returns the answer; of an InputError the message is the answer.
    """

    def serve(_request: object, response: Trigger.Response) -> Trigger.Response:
        try:
            message = save()
            response.success = True
        except InputError as fault:
            message = str(fault)
        except Exception as error:
            # rclpy would send no answer, for which the client waits
            logger.exception("The %s could not be saved", what)
            message = f"failure inside: {type(error).__name__}: {error}; see the node's log"
        response.message = printable(message)
        node.get_logger().info(f"Told to save the {what}: {response.message}")
        return response

    node.create_service(Trigger, name, serve)
