"""frame_angles.csv: what pictures told of their heads' angles in operation, by station and stamp of the frame."""

from collections.abc import Mapping

from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable
from groundstation.files.toml_table import quoted
from groundstation.messages import FrameAngles
from groundstation.rig.rig_limits import LONGEST_READOUT_S
from groundstation.session import Session

NAME = "frame_angles.csv"
# in radians: not every angle has a number of degrees that reads as it bit for bit
COLUMNS = ("t_s", "station", "pan_rad", "tilt_rad", "sigma_rad")
# of a rolling shutter only
DELAY = "delay_s"


class FrameAnglesTable:
    """The angles of a session folder's frames; none where it has no such table.

    ``fault`` is what ended the reading, None for a table that is whole; the rows before it are there.
    """

    def __init__(self, session: Session) -> None:
        self.fault: SessionError | None = None
        self._rows: dict[tuple[str, float], FrameAngles] = {}
        path = session.folder / NAME
        if not path.is_file():
            return
        try:
            self._read(CsvTable(path, COLUMNS), session)
        except SessionError as fault:
            self.fault = fault

    def _read(self, table: CsvTable, session: Session) -> None:
        clocks = {s.name: session.camera_clock(s) for s in session.rig.stations}
        for row in table:
            name = row.text["station"].strip()
            if name in session.left_out:
                continue
            if name not in clocks or session.rig[name].fixed:
                turning = ", ".join(s.name for s in session.rig.stations if not s.fixed)
                raise table.fault(row.line, got=f"station {quoted(name)}", wanted=f"one that turns: {turning}")
            t_s = clocks[name].session_from_device(table.number(row, "t_s"))
            pan, tilt, sigma = (table.number(row, column) for column in COLUMNS[2:])
            if sigma <= 0.0:
                raise table.fault(row.line, got=f"sigma_rad = {sigma:g}", wanted="> 0")
            delay = table.number(row, DELAY) if DELAY in table.columns else 0.0
            if abs(delay) > LONGEST_READOUT_S:
                wanted = f"seconds, at most {LONGEST_READOUT_S:g} either way"
                raise table.fault(row.line, got=f"{DELAY} = {delay:g}", wanted=wanted)
            self._rows[name, t_s] = FrameAngles(
                t_s=t_s, station=name, pan_rad=pan, tilt_rad=tilt, sigma_rad=sigma, delay_s=delay
            )

    def of_frame(self, station: str, t_s: float) -> FrameAngles | None:
        """Return the angles of a station's frame of a session time, None where its picture told none."""
        return self._rows.get((station, t_s))

    def notes(self, stamps_s: Mapping[str, FloatArray]) -> list[str]:
        """Return a note on the rows that are none of the frames, whose times are ``stamps_s`` by station."""
        frames = {name: set(times.tolist()) for name, times in stamps_s.items()} if self._rows else {}
        unused = [(name, t_s) for name, t_s in self._rows if t_s not in frames.get(name, ())]
        if not unused:
            return []
        name, t_s = unused[0]
        return [
            f"{NAME}: {len(unused)} of {len(self._rows)} rows are of no frame and are not used, the first of {name} at "
            f"{t_s:.13g} s: frames.csv has no such time"
        ]
