"""Starts the odometry beside a camera driver, or on a bag.

ros2 launch rgbd_glue_ros odometry.launch.py camera:=realsense_d400
ros2 launch rgbd_glue_ros odometry.launch.py color:=/my/color depth:=/my/depth camera_info:=/my/info
ros2 launch rgbd_glue_ros odometry.launch.py camera:=realsense_d400 mapping:=true
ros2 launch rgbd_glue_ros odometry.launch.py camera:=oak_d bag:=drive compressed:=true rviz:=true
"""

from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchContext, LaunchDescription
from rgbd_glue_ros.live.camera_presets import TOPIC_ARGUMENTS, camera_names, load_camera, remappings
from rgbd_glue_ros.parameters import (
    PACKAGE,
    NodeConfig,
    parameters,
    profiles_file,
    share_directory,
)

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
COMPRESSED = {"image_transport": "compressed", "depth_transport": "compressedDepth"}


def actions(context: LaunchContext) -> list[Node | ExecuteProcess]:
    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    bag, file = given("bag"), given("params_file")
    is_simulated = "true" if bag else given("use_sim_time")
    # where nothing is given, the parameter file decides
    time = {"use_sim_time": is_simulated == "true"} if is_simulated else {}
    camera = load_camera(given("camera")) if given("camera") else None
    types = {p.name: p.type for p in parameters(NodeConfig())}
    arguments = {
        **{n: ParameterValue(given(n), value_type=kind) for n, kind in types.items() if given(n)},
        **time,
    }

    def node(executable: str) -> Node:
        return Node(
            package=PACKAGE,
            executable=executable,
            namespace=given("namespace"),
            # each overrides those before it
            parameters=[
                *([dict(camera.parameters)] if camera else []),
                *([COMPRESSED] if given("compressed") == "true" else []),
                *([file] if file else []),
                *([arguments] if arguments else []),
            ],
            remappings=remappings(camera, {name: given(name) for name in TOPIC_ARGUMENTS}),
            output="screen",
        )

    player = ExecuteProcess(cmd=["ros2", "bag", "play", bag, "--clock"], output="screen")
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        namespace=given("namespace"),
        arguments=["-d", str(share_directory() / "config" / "odometry.rviz")],
        parameters=[time] if time else [],
    )
    return [
        node("odometry"),
        *([node("mapping")] if given("mapping") == "true" else []),
        *([player] if bag else []),
        *([rviz] if given("rviz") == "true" else []),
    ]


def generate_launch_description() -> LaunchDescription:
    switch = {"choices": ["true", "false"], "default_value": "false"}
    arguments = [
        DeclareLaunchArgument(
            "camera",
            default_value="",
            choices=["", *camera_names()],
            description="Preset that gives topics and parameters.",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes."),
        DeclareLaunchArgument(
            "params_file",
            default_value="",
            description="Parameter file, which only arguments override.",
        ),
        DeclareLaunchArgument(
            "compressed",
            **switch,
            description="Whether images are compressed and compressedDepth.",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="",
            choices=["", "true", "false"],
            description="Whether time comes from /clock; true with bag, else as the file says.",
        ),
        DeclareLaunchArgument(
            "mapping",
            **switch,
            description="Whether to also start mapping: closes loops, map -> odom on TF.",
        ),
        DeclareLaunchArgument("bag", default_value="", description="Bag to play, with its clock."),
        DeclareLaunchArgument("rviz", **switch, description="Whether to start RViz."),
        *(
            DeclareLaunchArgument(
                name, default_value="", description=f"Topic for {own}, without the transport."
            )
            for name, own in TOPIC_ARGUMENTS.items()
        ),
        *(
            DeclareLaunchArgument(
                parameter.name,
                default_value="",
                description=f"{parameter.description} Without it: {parameter.default!r}.",
            )
            for parameter in parameters(NodeConfig())
        ),
    ]
    # without the profile, images of 640x480 are lost between processes
    profiles = EnvironmentVariable(PROFILES, default_value=str(profiles_file()))
    return LaunchDescription(
        [*arguments, SetEnvironmentVariable(PROFILES, profiles), OpaqueFunction(function=actions)]
    )
