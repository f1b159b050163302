"""The files of docs/images: how each is made, and what has to be there for it."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pages import picture_makers as make
from pages.workshop import Workshop

_VULKAN = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"))
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str | None:
    """Return what is missing for a page in a browser, or nothing."""
    return None if any(map(shutil.which, _BROWSERS)) else "Chromium is not here: apt install chromium"


def vulkan() -> str | None:
    """Return what is missing for Rerun's own viewer without a display, or nothing."""
    if not any(folder.is_dir() and any(folder.glob("*.json")) for folder in _VULKAN):
        return "no Vulkan driver is here: apt install mesa-vulkan-drivers"
    return None


def vulkan_and_video() -> str | None:
    """Return what is missing for that viewer to show an MP4 video, or nothing."""
    return vulkan() or (None if shutil.which("ffmpeg") else "ffmpeg is not here: apt install ffmpeg")


def nothing() -> str | None:
    """Return that nothing is missing."""
    return None


@dataclass(frozen=True, slots=True)
class Picture:
    """A file of docs/images: what makes it (in a workshop, at a path), and what tells whether its need is there.

    ``at_rest``: shows what plays in real time, on a machine with nothing else to do; made where it is named.
    """

    name: str
    maker: Callable[[Workshop, Path], None]
    missing: Callable[[], str | None] = nothing
    at_rest: bool = False


PICTURES = (
    Picture("landing.gif", make.landing),
    Picture("report.png", make.report, chromium),
    Picture("report-phone.png", make.report_on_a_phone, chromium),
    Picture("first-report.png", make.first_report, chromium),
    Picture("site.png", make.site, chromium),
    Picture("simulated.png", make.simulated),
    Picture("plan.png", make.plan),
    Picture("first-view.png", make.first_view, vulkan),
    Picture("rerun.png", make.rerun, vulkan_and_video),
    Picture("rerun-two-runs.png", make.rerun_two_runs, vulkan_and_video),
    Picture("rerun-browser.png", make.rerun_in_browser, chromium, at_rest=True),
    Picture("rerun-recording.png", make.rerun_recording, vulkan, at_rest=True),
    Picture("rerun-mcap.png", make.rerun_mcap, vulkan, at_rest=True),
    Picture("live.png", make.live, chromium, at_rest=True),
    Picture("onboard-pose-path.png", make.onboard_pose),
    Picture("onboard-pose-position.png", make.onboard_pose),
    Picture("onboard-pose-errors.png", make.onboard_pose),
    Picture("onboard-pose-innovations.png", make.onboard_pose),
    Picture("integrity-stanford.png", make.integrity_stanford),
    Picture("touchdown.png", make.touchdown),
)


def remade(shop: Workshop, folder: Path, names: Sequence[str] | None = None) -> Iterator[str]:
    """Make the pictures again, all or those that are named; yield a line for each: made, or why not.

    A picture takes its place when it is whole.
    """
    chosen = [picture for picture in PICTURES if names is None or picture.name in names]
    for picture in chosen:
        (shop.folder / picture.name).unlink(missing_ok=True)
    for picture in chosen:
        why = picture.missing()
        if why is None and picture.at_rest and names is None:
            why = f"plays in real time: make it on a machine at rest, --pictures {picture.name}"
        if why is not None:
            yield f"{picture.name}: left as it is: {why}"
            continue
        made = shop.folder / picture.name
        picture.maker(shop, made)
        shutil.copyfile(made, folder / picture.name)
        yield f"{picture.name}: made"
