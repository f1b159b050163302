"""Options of the commands that watch an approach: landing site, autopilot, JSON lines."""

import argparse
from typing import TYPE_CHECKING

from groundstation.autopilot.settings import AutopilotMode
from groundstation.cli.path_arguments import READ
from groundstation.cli.wrong_usage import refused_as_usage
from groundstation.errors import UsageError

if TYPE_CHECKING:
    from groundstation.approach.approach_options import ApproachOptions
    from groundstation.autopilot.settings import AutopilotSettings


def add_approach(parser: argparse.ArgumentParser, origin: str) -> None:
    """Add the options; ``origin`` is the table that says where the runway frame is on Earth."""
    group = parser.add_argument_group("the approach")
    group.add_argument(
        "--site", type=READ, metavar="FILE", help="landing site, TOML: advice (GO, WAVE-OFF), glide path, touchdown"
    )
    group.add_argument("--autopilot", metavar="URL", help=f"send the position to a vehicle by MAVLink; needs {origin}")
    modes = [str(mode) for mode in AutopilotMode]
    group.add_argument(
        "--autopilot-mode", choices=modes, metavar="MODE", help=f"which message carries it: {', '.join(modes)}"
    )
    group.add_argument(
        "--autopilot-settings", type=READ, metavar="FILE", help="autopilot file, TOML: lever arm, delays, key, ids"
    )
    group.add_argument("--udp", metavar="HOST:PORT", help="send each estimate as a JSON line")


def approach_options(options: argparse.Namespace, of_station: "AutopilotSettings | None" = None) -> "ApproachOptions":
    """Return what the options ask for, over a station file's autopilot. Raises `ConfigError` or `UsageError`."""
    from groundstation.approach.approach_options import ApproachOptions
    from groundstation.autopilot.link_url import parse_link_url
    from groundstation.autopilot.settings import load_autopilot, with_link
    from groundstation.landing_site.landing_site_file import load_landing_site
    from groundstation.sinks.udp_json import parse_udp_address

    with refused_as_usage():
        if options.udp is not None:
            parse_udp_address(options.udp)
        if options.autopilot is not None:
            parse_link_url(options.autopilot)
    file = of_station if options.autopilot_settings is None else load_autopilot(options.autopilot_settings)
    autopilot = file
    if options.autopilot is not None or options.autopilot_mode is not None:
        if options.autopilot is None and file is None:
            raise UsageError("--autopilot-mode", got="no --autopilot", wanted="the vehicle's URL")
        url = options.autopilot if file is None or options.autopilot is not None else file.url
        autopilot = with_link(file, url, options.autopilot_mode)
    return ApproachOptions(
        site=None if options.site is None else load_landing_site(options.site), autopilot=autopilot, udp=options.udp
    )
