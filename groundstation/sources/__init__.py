"""Sources of events: session folders, recordings, videos, cameras."""
