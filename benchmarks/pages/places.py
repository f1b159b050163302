"""Where each figure of the results' table stands in the notes: its sentence, or its row and column.

By the words of the table's first column, in the order of its figures, templates (benchmarks/pages/passages.py) of text
from one passage of the linked section: a paragraph, a list's item, a table's row.
"""

_AT = "At y 100–250 m, these pairs: landing-1 "
_NIS = "NIS per degree of freedom (1 is ideal): landing-1 "
_CLIPS = "| {} | _ | _ | "
_SPEED = "| {} | _ | _ | "
_HORIZON = "| horizon to {}° | _ | "
_TWELVE = "| 30 pairs/s, ten minutes, twelve approaches, today's code "

PLACES: dict[str, tuple[str, ...]] = {
    "landing-1, y 100–250 m, RMSE": (_AT + "#/#/# (",),
    "stream at the moment of use, radio of 30–200 ms: rms over the filter's": (
        "ratio # (GPS_INPUT, ArduPilot as `autopilot check` recommends) to # (PX4",
    ),
    "100 landings on the stream, GPS_INPUT: height below 20 m; scatter across": (
        "height below 20 m # and ~ m rms;",
        "along, # (95 %: 1.03–1.23) and",
    ),
    "misleading approaches, faults by stated priors": (
        "| – misleading | # |",
        "| approaches by their priors [nature] | # |",
    ),
    "touchdown ellipse at 10, 5, 2 s; sigma over that with the true state": (
        "in #, #, # % of cases",
        "its sigmas are at most # times",
    ),
    "GNSS step called within 1 s (RTK 3 m, plain 12 m); false": (
        "with a plain one, # of # each are called",
        "after 0.60 s; # false calls",
    ),
    "takeoff-1, y 100–250 m, RMSE": (_AT + "…; takeoff-1 #/#/# (",),
    "landing-1, ANEES there; NIS of all pairs": (_AT + "…, ANEES #; takeoff-1", _NIS + "# of"),
    "takeoff-1, ANEES there; NIS of all pairs": (_AT + "…; takeoff-1 …, ANEES #: its", _NIS + "~ of …, takeoff-1 # of"),
    "filter's RMSE over its bound, 200 flights a case": (
        "| B, 10 Hz | 200 | _ | _ | _ | ~/#/~ |",
        "| B, 10 Hz | 200 | ~/#/~ |",
    ),
    "5 % gross outliers, RMSE over that without": ("5 % outliers within ±50 px, 200 flights: RMSE #/#/#",),
    "gain over triangulation, y 40–450 m, flights from 600 m": (
        "From y = 600 m, where the bounds' flights begin: #/#/#, the bounds' own",
    ),
    "clocks estimated on line, rms error over bound: worst with DGPS, with a camera as reference": (
        "| left camera | ~ / ~ | ~ | ~ | ~ / ~ | # |",
        "With a camera as the reference, on the drawn flights (60) # right camera",
    ),
    "drawn take-offs, clocks over their bounds, least–most": (
        "| left PTU | ~; ~ | ~ (~) | ~; # |",
        "| right camera | ~; ~ | ~ (~) | #; ~ |",
    ),
    "takeoff-1's clocks: PTUs (true: 37 ms); error of the log's": (
        "| left PTU against its camera | _ | # |",
        "The log's clock is # ms off, by true pixels ~:",
    ),
    "drawn rigs after calibration, relative pan; tilt, rms": (
        "| `clocks`: and cameras and PTUs by 20 ms, heads that hold a weaving aircraft | _ | _ | _ | #° (~°) | #° (",
    ),
    "real cameras, hexacopter with RTK, 3-D: worst pair of three good cameras; all four": (
        "| as shipped | _ | ~ (~) | # (",
        "| as shipped | # (",
    ),
    "the same, seven sets of cameras, ANEES while tracking; while coasting; NIS not compared": (
        "| sony5n + sony5100 | _ | # | _ | _ | _ | ~ |",
        "| gopro3 + sonyG | _ | # | _ | _ | _ | ~ |",
        "| sony5n + sonyG | _ | ~ | _ | _ | _ | # |",
        "| all four | ~ | ~ | _ | _ | _ | # |",
    ),
    "heads by drawn nights, relative pan; over its bound": ("| relative pan | #° | _ | # | _ |",),
    "a knock of 0.01° found (each axis); false alarms": (
        "| left base knocked by 0.01° in pan, found | _ | # of # |",
        "| a rig that stands: false alarms; mean statistic (3 expected) | _ | # of #;",
    ),
    "real clips, started: hit; wrong": (_CLIPS.format("started on the first box") + "# | # |",),
    "worst segment: hit": (_CLIPS.format("started on the first box") + "~ | ~ | # |",),
    "worst of 10 Hz, half resolution, noise of 8: hit": (_CLIPS.format("started, noise of 8 grey levels") + "# |",),
    "real clips, found by searching: hit; wrong": (_CLIPS.format("found by searching, from 0.5 s on") + "# | # |",),
    "time of an update over OpenCV's CSRT: median; worst segment": (
        "the median update takes # of CSRT's over all 28 segments (~ and ~ ms), ~ on the code before "
        "(~ and ~ ms; by segment ~ to #)",
    ),
    "track captured by a bird; longest re-acquisition": (
        "| 1 | # |",
        "None of the # is captured.",
        "| 2 | ~ | ~ | ~ of ~ | ~ of ~ | # |",
    ),
    "rendered, point on sky, rms u/v; at 80–100 px v alone": (
        "| 15–100 together | ~ | ~ | #/# |",
        "| 80–100 | 51 | ~ | ~/# |",
    ),
    "the same, NIS of one flight; of each frame's new part": ("| 15–100 together | _ | _ | _ | _ | _ | # (~–~) | # (",),
    "drawn aircraft, NIS at 40–60 px; from 200 px": (
        "| 40–60 | 14 | _ | _ | _ | # (",
        "| from 200 | 8 | _ | _ | _ | # (",
    ),
    "rendered, elsewhere, rms u/v in % of the width: landing-1; worst bin": (
        "| landing-1, all but sky below 100 | _ | _ | _ | #/# |",
        "| takeoff-1, ground, 60–80 | _ | _ | _ | #/# |",
    ),
    "rendered, median IoU on sky below 80 px; from 120 px": (
        "| below 80 together | _ | _ | _ | _ | # |",
        "| from 120 together | _ | _ | _ | _ | # |",
    ),
    "rendered, nose and silhouette in the region of interest": (
        "Nose and silhouette lie in the region in # % of the frames of both",
    ),
    "region of interest against the full frame, mean deviation u/v": ("| 300 × 120 | _ | _ | # / # |",),
    "level set, times as fast as scikit-image's, same contour, by the rule: least; most": (
        _SPEED.format("ground, 106 px") + "_ | ~ (# ×),",
        _SPEED.format("sky, 45 px") + "_ | ~ (# ×),",
    ),
    "the same from the level set's first step: least; most": (
        _SPEED.format("ground, 135 px (reduced)") + "_ | _ | ~ (# ×),",
        _SPEED.format("sky, 45 px") + "_ | _ | ~ (# ×),",
    ),
    "whole detector, slower of two runs: median; 99 %": (
        "two runs of today, one after the other: ~ and # ms median, ~ and # at 99 %",
    ),
    "PTU fault runs (FLIR): accepted angles that were wrong": (
        "| of them wrong: off the truth by more than 2 counts and 5 sigma of the stated instant | # |",
        "| angles accepted | # |",
    ),
    "readings of both axes, 9600 baud: virtual; slowest on a pty": (
        "| virtual | pair | 9600 baud | # |",
        "| ordinary, nothing else at work | #/s |",
    ),
    "live, twelve approaches, 30 pairs/s: delay while tracking, median; 99 %": (
        _TWELVE + "| _ | _ | _ | _ | # / # ms while tracking",
    ),
    "live: growth of memory in ten minutes": ("of the last ten ~: a growth of # MB",),
    "live: nose in the central half of the picture": (_TWELVE + "| _ | _ | _ | # % of",),
    "live: error over a replay's, the same flight": ("| all | _ | _ | #/#/# |",),
    "killed while recording: lost at most": ("of the flight ~ s lost (median), # s at most",),
    "a process lost: heads stand after; state right after, at most": (
        "| ptu-guard | KILL, STOP, TERM | ~ | # s |",
        "| ptus | KILL, STOP, TERM | ~ | ~ s | # s |",
    ),
    "replay over decoding alone: without Rerun; with it": (
        _SPEED.format("replay without Rerun") + "~; # | ~–~;",
        _SPEED.format("replay, all outputs") + "~; # |",
    ),
    "an hour's replay, growth of memory: pixels with DGPS; pictures": (
        "| that in parts of 1024 pairs | _ | _ | _ | # |",
        "| videos above 250 MB go into Rerun picture by picture | _ | _ | _ | # |",
    ),
    "seeded faults found by the tests, of 319 tried; 119 are listed and not tried": ("~ found (# %; wanted",),
    "fuzz: inputs of each reader; recordings": ("53 readers, # inputs of each,", "; # recordings of mutated structure"),
    "runway edges from the nose, RMSE; worst approach": ("load ~ to ~): # px, median", "short final 15001 # px (~)"),
    "300 test approaches: rms px, median; misleading": (
        "rms of an approach in the median # px, 90 % ~; # of # frames misleading",
    ),
    "processor time of a tracking frame under load, 99 %": ("Tracking median ~ ms, 99 % # ms, first",),
    "first; acquiring frames, median": ("99 % ~ ms, first #, acquiring #",),
    "the same with the horizon to 0.05°, at 1–2 km; 2–4 km": (_HORIZON.format("0.05") + "# | # |",),
    "its NEES (6), farthest of three noises; 12,000 other views": (
        "(`--only noise`): ~ at 0.3 px, ~ at 0.5 px, # at 1 px",
        "On ~ other views at 1 px ~ became # (",
    ),
    "nose camera to a trajectory, worst of twenty: RMSE y; NEES (6) of an epoch": (
        "| haze 29502 | _ | ~/#/~ |",
        "| haze 29502 | _ | _ | _ | _ | # |",
    ),
}
