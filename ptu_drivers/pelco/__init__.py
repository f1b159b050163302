"""Pan-tilt units with the protocols Pelco-D or Pelco-P."""
