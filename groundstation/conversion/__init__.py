"""Sessions made of something else: of videos with a log (`import`), of a recording or of a folder (`convert`)."""
