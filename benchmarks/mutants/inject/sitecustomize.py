"""Read by Python as it starts, when this folder is on PYTHONPATH: imports one module with a fault, or all with marks.

MUTANTS_MODULE and MUTANTS_SOURCE: this module is made of that file's text. MUTANTS_HITS: each function of the packages
writes its name into that file when it is first called (``mutants.coverage``).
"""

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType

PACKAGES = ("groundstation", "calibration", "ptu_drivers")


class Changed(SourceFileLoader):
    """Compiles a module from a changed text and ignores its cached bytecode."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Code of the changed module, in the name of its own file."""
        file = self.get_filename(fullname)
        if fullname == os.environ.get("MUTANTS_MODULE"):
            return compile(Path(os.environ["MUTANTS_SOURCE"]).read_text(encoding="utf-8"), file, "exec")
        sys.path.append(str(Path(__file__).resolve().parents[2]))
        try:
            from mutants.marks import marked
        finally:
            sys.path.pop()
        return compile(marked(Path(file).read_text(encoding="utf-8"), fullname), file, "exec")


class Finder:
    """Puts `Changed` in the place of the usual loader, for the modules concerned."""

    @staticmethod
    def find_spec(name: str, path: list[str] | None = None, target: object = None) -> ModuleSpec | None:
        """The usual specification with another loader; None leaves a module to the usual finders."""
        if name.split(".")[0] not in PACKAGES:
            return None
        if name != os.environ.get("MUTANTS_MODULE") and "MUTANTS_HITS" not in os.environ:
            return None
        folders = [os.environ["MUTANTS_ROOT"]] if path is None else path
        spec = PathFinder.find_spec(name, folders, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = Changed(spec.loader.name, spec.loader.path)
        return spec


if "MUTANTS_MODULE" in os.environ or "MUTANTS_HITS" in os.environ:
    sys.meta_path.insert(0, Finder)
