"""Services that save something, and always answer, even if saving fails."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.printable import printable

Result = TypeVar("Result")
logger = logging.getLogger(__name__)


def create_save_service(node: Node, name: str, what: str, save: Callable[[], str]) -> None:
    """Creates a service that saves something, while all other callbacks of the node go on.

    Args:
        node: provides the service and the log.
        name: name of the service.
        what: what is saved, in one word, for the log.
        save: saves it and returns the response message; the message of an InputError is sent too.
            Called on a thread of its own.
    """
    thread = ThreadPoolExecutor(1, thread_name_prefix=f"save-{what}")

    def saved() -> tuple[bool, str]:
        try:
            return True, save()
        except InputError as fault:
            return False, str(fault)
        except Exception as error:
            # rclpy would send no response, and the client would wait for it
            logger.exception("The %s could not be saved", what)
            return False, f"internal error: {type(error).__name__}: {error}; see the node's log"

    async def serve(_request: object, response: Trigger.Response) -> Trigger.Response:
        response.success, message = await _result_of(node, thread, saved)
        response.message = printable(message)
        line = f"Saving the {what}: {response.message}"
        if response.success:
            node.get_logger().info(line)
        else:
            node.get_logger().error(line)
        return response

    # in the node's group, all other callbacks would wait for it
    node.create_service(Trigger, name, serve, callback_group=MutuallyExclusiveCallbackGroup())


async def _result_of(node: Node, thread: ThreadPoolExecutor, work: Callable[[], Result]) -> Result:
    """The result of work that must not raise, while the node's executor runs other callbacks."""
    executor = node.executor
    future = Future(executor=executor)

    def run() -> None:
        future.set_result(work())
        with suppress(InvalidHandle):  # the executor has ended meanwhile
            executor.wake()

    thread.submit(run)
    result: Result = await future
    return result
