"""Parts of benchmarks/onboard_pose.py."""
