"""Bags of ROS: how they are opened, and what may be unpacked of them."""
