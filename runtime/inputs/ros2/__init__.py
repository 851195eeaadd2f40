"""ROS 2 over DDS without ROS: publishers and subscriptions that ROS 2's own programs see as theirs."""
