"""What a replay writes into its output folder (docs/formats.md)."""

# as patterns of names; a test replays a session and compares
REPLAY_FILES = (
    *("track.csv", "triangulation.csv", "detections.csv", "smoothed.csv", "track.tum", "truth.tum", "dgps.tum"),
    *("track.kml", "track.geojson"),
    *("summary.json", "report.html", "session.rrd", "figures", "landings.json"),
)
