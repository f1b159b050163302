"""Image registration: how one picture, or a panorama, lies on another."""
