"""Pan-tilt units that speak Pelco-D or Pelco-P."""
