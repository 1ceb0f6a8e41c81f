"""ros2 launch splatseg_ros splatseg.launch.py map:=home.ply"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    parameters = Path(get_package_share_directory("splatseg_ros")) / "config/splatseg.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("parameters", default_value=str(parameters)),
            DeclareLaunchArgument("map", default_value="home.ply"),
            Node(
                package="splatseg_ros",
                executable="splatseg_node",
                name="splatseg",
                output="screen",
                parameters=[LaunchConfiguration("parameters"), {"map": LaunchConfiguration("map")}],
                # Time to save a large map.
                sigterm_timeout="10",
            ),
        ]
    )
