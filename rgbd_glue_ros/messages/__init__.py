"""ROS messages as NumPy sees them: images, camera infos, stamps and transforms, without ROS."""
