"""The ROS node, and the one folder that imports rclpy."""
