from setuptools import setup

NAME = "splatseg_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/splatseg.launch.py"]),
        (f"share/{NAME}/config", ["config/splatseg.yaml"]),
    ],
    install_requires=["setuptools", "splatseg"],
    entry_points={"console_scripts": ["splatseg_node = splatseg.ros2_node:main"]},
)
