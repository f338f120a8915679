# SPDX-License-Identifier: Apache-2.0
# The hover stack on Ubuntu's own ROS 2 Jazzy, in the place of the wheels from PyPI:
#
#   docker build -t heli .
#   docker run --rm --shm-size=1g heli ./hover_test.sh --no-report
#
# The image's entry point sources /opt/ros/jazzy/setup.bash, and Fast DDS wants shared memory.

FROM ros:jazzy AS dependencies
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /heli
COPY src src
# The keys that are skipped come by pip, into .venv-ros (CONTRIBUTING.md).
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install -y --from-paths src --ignore-src --skip-keys "python-control-pip python3-rosbags-pip mcap-ros2-support python3-typer" \
    && rm -rf /var/lib/apt/lists/*
RUN echo 'source /opt/ros/jazzy/setup.bash' >>/etc/bash.bashrc

FROM dependencies
COPY . .
# Makes .venv-ros, builds with colcon, compiles the kernels.
RUN /ros_entrypoint.sh ./heli --help
CMD ["bash"]
