"""ROS messages -> NumPy: images, camera infos, stamps and transforms, without ROS."""
