"""``cube.knitlab`` on every xarray Dataset, without importing xarray, which takes 0.4 s.

Python asks the finders of ``sys.meta_path`` for each module that is imported for the first time.
One more finder, for xarray only, adds the accessor as soon as somebody has imported xarray.
"""

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from knitlab.cube.query import KnitlabAccessor


def register_accessor() -> None:
    """Make ``cube.knitlab`` available, now or when xarray is imported."""
    if "xarray" in sys.modules:
        _register(sys.modules["xarray"])
    else:
        sys.meta_path.insert(0, _XarrayFinder())


class _XarrayFinder:
    """Finds xarray as the finders after it do, and adds the accessor to its import."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "xarray":
            return None
        following = sys.meta_path[sys.meta_path.index(self) + 1 :]
        specs = (finder.find_spec(name, path, target) for finder in following)
        spec = next((found for found in specs if found), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                _register(module)

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def _register(xarray: ModuleType) -> None:
    if not hasattr(xarray.Dataset, "knitlab"):
        xarray.register_dataset_accessor("knitlab")(_accessor)


def _accessor(cube: "xr.Dataset") -> "KnitlabAccessor":
    # Modules that it needs may be those that import xarray just now.
    from knitlab.cube.query import KnitlabAccessor

    return KnitlabAccessor(cube)
