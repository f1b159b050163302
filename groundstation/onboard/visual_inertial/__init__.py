"""The aircraft's own camera and inertial unit together: edges, corners, pose, filter, trajectory."""
