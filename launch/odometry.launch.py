"""Starts the odometry beside a camera driver.

ros2 launch rgbd_glue_ros odometry.launch.py color:=/camera/color/image_raw \
  depth:=/camera/aligned_depth_to_color/image_raw camera_info:=/camera/color/camera_info
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchContext, LaunchDescription
from rgbd_glue_ros.config import PACKAGE, NodeConfig, parameters, share_directory
from rgbd_glue_ros.topics import SUBSCRIBED

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


def odometry(context: LaunchContext) -> list[Node]:
    file = LaunchConfiguration("params_file").perform(context)
    types = {p.name: p.type for p in parameters(NodeConfig())} | {"use_sim_time": bool}
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, kind in types.items()
        if LaunchConfiguration(name).perform(context)
    }
    node = Node(
        package=PACKAGE,
        executable="odometry",
        namespace=LaunchConfiguration("namespace"),
        parameters=[*([file] if file else []), given],
        remappings=[
            (topic, LaunchConfiguration(channel.value)) for channel, topic in SUBSCRIBED.items()
        ],
        output="screen",
    )
    return [node]


def generate_launch_description() -> LaunchDescription:
    arguments = {
        "namespace": ("", "Namespace of the node."),
        "params_file": ("", "Parameter file; what is given as an argument goes before it."),
        "use_sim_time": ("false", "Whether time comes from /clock, as with a bag."),
    }
    for channel, topic in SUBSCRIBED.items():
        arguments[channel.value] = topic, f"Topic of the {channel.value}, without the transport."
    for parameter in parameters(NodeConfig()):
        meaning = f"{parameter.description} Without it: {parameter.default!r}."
        arguments[parameter.name] = "", meaning
    # without the profile, images of 640x480 are lost between processes
    profiles = EnvironmentVariable(
        PROFILES, default_value=str(share_directory() / "config" / "fastdds.xml")
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=meaning)
                for name, (default, meaning) in arguments.items()
            ),
            SetEnvironmentVariable(PROFILES, profiles),
            OpaqueFunction(function=odometry),
        ]
    )
