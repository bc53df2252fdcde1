"""An image that comes in another transport is found, with the arguments that subscribe to it."""

from __future__ import annotations

import pytest

from rgbd_glue_ros.live.input_faults import Input, explain_silence
from rgbd_glue_ros.live.transports import COMPRESSED_IMAGE, IMAGE, OtherTransport, other_transport
from rgbd_glue_ros.messages.synchronizer import Channel

COLOR, DEPTH = Channel.COLOR, Channel.DEPTH
# channel, the name that the node's is remapped to, its transport, what is published, and what to do
FOUND = [
    (COLOR, "/c/image", "raw", "/c/image/compressed", "-p image_transport:=compressed"),
    (COLOR, "/c/image", "compressed", "/c/image", "-p image_transport:=raw"),
    (DEPTH, "/d/image", "raw", "/d/image/compressedDepth", "-p depth_transport:=compressedDepth"),
    (DEPTH, "/d/image", "raw", "/d/image/compressed", "-p depth_transport:=compressed"),
    (DEPTH, "/d/image", "compressedDepth", "/d/image", "-p depth_transport:=raw"),
    (
        *(COLOR, "/c/image/compressed", "raw", "/c/image/compressed"),
        "-r rgb/image:=/c/image -p image_transport:=compressed",
    ),
    (
        *(COLOR, "/c/image/compressed", "compressed", "/c/image/compressed"),
        "-r rgb/image:=/c/image",
    ),
    (
        *(DEPTH, "/d/image/compressedDepth", "raw", "/d/image"),
        "-r depth/image:=/d/image",
    ),
]


def kind_of(topic: str) -> str:
    return COMPRESSED_IMAGE if "/compressed" in topic else IMAGE


@pytest.mark.parametrize(("channel", "base", "transport", "published", "arguments"), FOUND)
def test_an_image_in_another_transport_is_found_with_the_arguments_that_subscribe_to_it(
    channel: Channel, base: str, transport: str, published: str, arguments: str
) -> None:
    found = other_transport(
        channel, base, transport, lambda topic: [kind_of(topic)] if topic == published else []
    )
    assert found == OtherTransport(published, arguments)


def test_an_image_that_comes_as_subscribed_or_not_at_all_has_no_other_transport() -> None:
    assert other_transport(COLOR, "/c", "raw", lambda topic: [kind_of(topic)]) is None
    assert other_transport(COLOR, "/c", "compressed", lambda topic: [kind_of(topic)]) is None
    assert other_transport(DEPTH, "/d", "raw", lambda _: []) is None
    # nor what has the name of an image, and another type
    assert other_transport(COLOR, "/c", "compressed", lambda _: [COMPRESSED_IMAGE]) is None
    assert other_transport(Channel.INFO, "/i", "raw", lambda _: [IMAGE]) is None


def test_silence_names_the_transport_that_is_published_and_what_else_is_missing() -> None:
    inputs = [
        Input(COLOR, "/c", (), 0, 0.0, OtherTransport("/c/compressed", "-p a:=b")),
        Input(DEPTH, "/d", (), 0, 0.0, OtherTransport("/d/compressedDepth", "-p c:=d")),
        Input(Channel.INFO, "/i", (), 0, 0.0),
    ]
    line = explain_silence(inputs, None, 20_000_000)
    assert line.endswith(
        "; /c/compressed and /d/compressedDepth are published: start the node with --ros-args "
        "-p a:=b -p c:=d; camera_info is missing: start the camera, or remap the topics to the "
        "names it uses"
    )
