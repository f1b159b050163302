"""What feeds Rerun."""
