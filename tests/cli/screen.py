"""A terminal for tests: it records what is written, and shows what a user would see."""

import io
import re

_TOKEN = re.compile(r"\x1b\[\??([0-9;]*)([A-Za-z])|\r|\n|[^\x1b\r\n]+")


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True

    def fileno(self) -> int:
        raise OSError("no descriptor")

    @property
    def colours(self) -> list[str]:
        """The colour and style codes written."""
        return [code for code in re.findall(r"\x1b\[([0-9;]*)m", self.getvalue()) if code not in ("", "0")]

    def rows(self) -> list[str]:
        """Return the rows on the screen, by cursor movements up, line ends and erased lines."""
        rows, row, column = [""], 0, 0
        for token in _TOKEN.finditer(self.getvalue()):
            text = token[0]
            if text == "\n":
                row, column = row + 1, 0
                rows += [""] * (row + 1 - len(rows))
            elif text == "\r":
                column = 0
            elif token[2] == "A":
                row = max(row - int(token[1] or 1), 0)
            elif token[2] == "K":
                rows[row] = ""
            elif token[2] is None:
                rows[row] = rows[row][:column].ljust(column) + text + rows[row][column + len(text) :]
                column += len(text)
        return [r.rstrip() for r in rows if r.strip()]
