"""Where each figure of the results' first table stands below: its sentence, or its row and column.

By the words of the table's first column, in the order of its figures, templates of text from one passage of the linked
section (a paragraph, a list's item, a table's row; bold and line breaks do not count):

    #   a figure of the table, as it stands there or rounded
    ~   any other number
    _   what stands in a table's cell, whatever it is
    …   any text within the passage
"""

_AT = "At y 100–250 m, these pairs: landing-1 "
_CLIPS = "| {} | _ | _ | "
_APPROACH = "| RMSE, px | {} |"
_SPEED = "| {} | _ | _ | "
_HORIZON = "| horizon to {}° | _ | "
_NOSE = "| {} | _ | "

PLACES: dict[str, tuple[str, ...]] = {
    "landing-1, y 100–250 m, RMSE": (_AT + "#/#/# (",),
    "takeoff-1, y 100–250 m, RMSE": (_AT + "…; takeoff-1 #/#/# (",),
    "the same, ANEES (1 is ideal)": (_AT + "…, ANEES #; takeoff-1 …, ANEES #",),
    "both sessions, all pairs, NIS": ("NIS per degree of freedom (1 is ideal): landing-1 # of …, takeoff-1 # of",),
    "filter's RMSE over its bound, 200 flights a case": (
        "| B, 10 Hz | 200 | _ | _ | _ | ~/#/~ |",
        "| B, 10 Hz | 200 | ~/#/~ |",
    ),
    "clocks learnt on line, rms error over bound, all biases free": (
        "| right camera | ~ / ~ | ~ | ~ | ~ / ~ | # |",
        "| left camera | ~ / ~ | ~ | ~ | ~ / ~ | # |",
        "With a camera as the reference, on the drawn flights (60) # right camera",
    ),
    "drawn take-offs, clocks over their bounds: cameras, PTUs, log": (
        "| right camera | ~; ~ | ~ (~) | #; ~ |",
        "| left PTU | ~; ~ | ~ (~) | ~; # |",
        "| right PTU | ~; ~ | ~ (~) | ~; # |",
        "| the log | ~; ~ | ~ (~) | #; # |",
    ),
    "takeoff-1's clocks: PTUs, cameras, log": (
        "| left PTU against its camera | _ | # |",
        "| right PTU against its camera | ~ ms | # |",
        "| right PTU against its camera | # ms |",
        "| right camera against left | _ | +# |",
        "The log's clock is # ms off, by true pixels #:",
        "| the log | ~; ~ | # (~) |",
    ),
    "5 % gross outliers, RMSE over that without": ("5 % outliers within ±50 px, 200 flights: RMSE #/#/#",),
    "gain over triangulation, y 40–450 m, flights from 600 m": (
        "From y = 600 m, where the bounds' flights begin: #/#/#, the bounds' own",
    ),
    "replay over decoding alone, without Rerun; with it": (
        _SPEED.format("replay without Rerun") + "#; # | #–#;",
        _SPEED.format("replay, all outputs") + "#; # |",
        "the old code took ~ ms and # (#",
    ),
    "real clips, started: hit, wrong; worst segment": (_CLIPS.format("started on the first box") + "# | # | # |",),
    "the same at 10 Hz, half resolution, noise of 8: hit": (
        _CLIPS.format("started, every third frame (10 Hz)") + "# |",
        _CLIPS.format("started, half resolution") + "# |",
        _CLIPS.format("started, noise of 8 grey levels") + "# |",
    ),
    "the same, time of one update over OpenCV's CSRT's, medians": (
        "the median update takes # of CSRT's over all 28 segments (~ and ~ ms), # on the code before "
        "(~ and ~ ms; by segment ~ to #)",
    ),
    "real clips, found by itself: hit, wrong": (_CLIPS.format("found by searching, from 0.5 s on") + "# | # |",),
    "track captured by a bird; longest way back": (
        "| 1 | # |",
        "None of the # is captured.",
        "| 2 | ~ | ~ | ~ of ~ | ~ of ~ | # |",
    ),
    "rendered, target point on sky, 15–100 px wide (there are 30–100), rms u/v": (
        "| 15–100 together | ~ | ~ | #/# |",
        "| #–# | 51 | ~ | #/# |",
    ),
    "rendered, the same, squared error over stated (NIS): whole, of one flight; new in each frame": (
        "| 15–100 together | _ | _ | _ | _ | _ | # (~–~) | # (",
    ),
    "drawn aircraft, 4° of crab, whole NIS at 40–60, 80–100, 120–200, from 200 px": (
        "| 40–60 | 14 | _ | _ | _ | # (",
        "| 80–100 | 16 | _ | _ | _ | # (",
        "| 120–200 | 16 | _ | _ | _ | # (",
        "| from 200 | 8 | _ | _ | _ | # (",
    ),
    "rendered, elsewhere, rms u/v in % of the silhouette's width: landing-1, takeoff-1": (
        "| landing-1, all but sky below 100 | _ | _ | _ | #/# |",
        "| takeoff-1, all but sky below 100 (all of it) | _ | _ | _ | #/# |",
        "| takeoff-1, ground, 60–80 | _ | _ | _ | #/~ |",
    ),
    "rendered, median IoU on sky, below 80, above 120 px": (
        "| below 80 together | _ | _ | _ | _ | # |",
        "| from 120 together | _ | _ | _ | _ | # |",
    ),
    "rendered, nose; silhouette in the region of interest": (
        "Nose and silhouette lie in the region in # % of the frames of both",
        "Nose and silhouette lie in the region in # % of the frames of both",
    ),
    "level set, times as fast as scikit-image's, three on sky, two on ground, a disc": (
        '"To IoU #":',
        _SPEED.format("sky, 33 px wide") + "~ ms (# ×) |",
        _SPEED.format("sky, 45 px") + "~ (# ×) |",
        _SPEED.format("sky, 74 px") + "~ (# ×) |",
        _SPEED.format("ground, 135 px (reduced)") + "~ (# ×) |",
        _SPEED.format("made-up disc, 14 px radius") + "~ (# ×) |",
        _SPEED.format("sky, 33 px wide") + "_ | ~ ms (# ×), IoU",
        _SPEED.format("sky, 45 px") + "_ | ~ (# ×),",
        _SPEED.format("sky, 74 px") + "_ | ~ (# ×),",
        _SPEED.format("ground, 106 px") + "_ | ~ (# ×),",
        _SPEED.format("ground, 135 px (reduced)") + "_ | ~ (# ×),",
        _SPEED.format("made-up disc, 14 px radius") + "_ | ~ (# ×),",
        _SPEED.format("sky, 33 px wide") + "_ | _ | ~ ms (# ×), IoU",
        _SPEED.format("sky, 45 px") + "_ | _ | ~ (# ×),",
        _SPEED.format("sky, 74 px") + "_ | _ | ~ (# ×),",
        _SPEED.format("ground, 106 px") + "_ | _ | ~ (# ×),",
        _SPEED.format("ground, 135 px (reduced)") + "_ | _ | ~ (# ×),",
        _SPEED.format("made-up disc, 14 px radius") + "_ | _ | ~ (# ×),",
    ),
    "level set, growth of its time with the contour's length, power": (
        "Time grows with the contour's length to the power #",
    ),
    "whole detector, median, 99 %": (
        "On the best day, code before: # ms and # ms over all",
        "two runs of today, one after the other: # and ~ ms median, # and ~ at 99 %",
        "two runs of today, one after the other: ~ and # ms median, ~ and # at 99 %",
        "On the best day, code before:…, ground # and",
        "two runs of today, one after the other:…, ground ~ and #",
    ),
    "region of interest against the full frame, mean deviation u/v": ("| 300 × 120 | _ | _ | # / # |",),
    "fault runs of pan-tilt units: angles believed that were wrong": (
        "| of them wrong: off the truth by more than 2 counts and 5 sigma of the stated instant | # |",
        "| angles believed | # |",
    ),
    "readings of both axes, 9600 baud": (
        "| virtual | pair | 9600 baud | # |",
        "| pty | pair | 9600 baud | # |",
        "| real-time, nothing else at work | #/s |",
        "| ordinary, nothing else at work | #/s |",
    ),
    "live, twelve approaches: delay while tracking, median, 99 %": (
        "| 30 pairs/s, ten minutes, twelve approaches, today's code | _ | _ | _ | _ | # / # ms while tracking",
        "| # pairs/s, ten minutes, twelve approaches, today's code |",
    ),
    "live: growth of memory in ten minutes": (
        "of the last ten ~: a growth of # MB",
        "Memory of the station's process every 15 s: # MB after a minute, ~ to # from then on",
    ),
    "live: nose in the central half of the picture": (
        "| 30 pairs/s, ten minutes, twelve approaches, today's code | _ | _ | _ | # % of",
    ),
    "live: error over a replay's, the same flight": ("| all | _ | _ | #/#/# |",),
    "killed while recording: lost at most": ("of the flight ~ s lost (median), # s at most",),
    "a knock of 0.01° about any axis, found by `calibrate check`; false alarms": (
        "| left base knocked by 0.01° in pan, found | _ | # of # |",
        "| check of another morning, the survey's table as reference | _ | # readings |",
        "| a rig that stands: false alarms; mean statistic (3 expected) | _ | # of #;",
    ),
    "drawn rigs after `calibrate flight`, relative pan and tilt, rms": (
        "| `clocks`: and cameras and PTUs by 20 ms, heads that hold a weaving aircraft | _ | _ | _ | #° (~°) | #° (",
    ),
    "real cameras, hexacopter with RTK, 3-D: pairs; all four": (
        "| as shipped | _ | # (~) | # (~) | # (",
        "| as shipped | # (",
    ),
    "an hour's replay: growth of memory, all included": (
        "| and the fixes let go before the report | _ | _ | _ | # |",
        "| that in parts of 1024 pairs | _ | _ | _ | # |",
        "| videos above 250 MB go into Rerun picture by picture | _ | _ | _ | # |",
    ),
    "runway edges from the nose, RMSE": (
        _APPROACH.format("0.3 | _ | _ | _ | _ | _ | #"),
        "(7 of the # have none)",
        "The median error is # px. It says",
        _APPROACH.format("# | # | 0.7 | _ | _ | #"),
        "| RMSE, px | 0.3 | _ | # | # | # |",
        "| each approach, px | _ | _ | _ | _ | #, 1.0, 0.8 |",
        "It says `tracking` in ~ % of the # frames; one of these",
        "| of these beyond χ² # % | 0 | 0 | 0 | 0 | 1 of",
        "frames; one of these (~ %) is beyond # px",
        "| squared error over stated, of ~ | 0.9 | 0.8 | _ | _ | _ | _ | # |",
        "| squared error over stated, of # | 0.9 | 0.8 |",
    ),
    "processor time of a frame that tracks the edges, median, 99 %; of first and acquiring frames, median": (
        "With nothing else at work (…): tracking median # ms, 99 % # ms",
        "cores: tracking median ~ ms, ~ % within 5 ms, 99 % # ms",
        "With nothing else at work (…; first frames median #, acquiring ones #, at most # ms",
    ),
    "the same with the horizon known to 0.2°, 0.05°, 0.01°, at 1–2 km; 2–4 km": (
        *(_HORIZON.format(angle) + "# |" for angle in ("0.2", "0.05", "0.01")),
        *(_HORIZON.format(angle) + "_ | # |" for angle in ("0.2", "0.05", "0.01")),
    ),
    "its covariance, NEES (6) at 0.3, 0.5, 1 px; 12,000 other views at 1 px": (
        "(`--only noise`): # at 0.3 px, # at 0.5 px, # at 1 px",
        "On ~ other views at 1 px ~ became # (",
    ),
    "nose camera to a trajectory, RMSE y, 190–45 m": (
        _NOSE.format("day 29501") + "~/#/~ |",
        _NOSE.format("haze 29502") + "~/#/~ |",
        _NOSE.format("dusk 28003") + "~/#/~ |",
        _NOSE.format("night 28003") + "~/#/~ |",
        "| light, seed | _ | _ | _ | NEES (#),",
        _NOSE.format("haze 28002") + "_ | _ | ~, # |",
        _NOSE.format("haze 29502") + "_ | _ | _ | # |",
        _NOSE.format("night 28003") + "_ | _ | _ | # |",
    ),
}
# figures that follow from those below, each with how
DERIVED = {
    "runway edges from the nose, RMSE": {"1.9": "the root of 4 over 1.09, by how much a stated sigma is too wide"},
}
