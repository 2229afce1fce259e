"""Public names of a package that are imported on first use.

The stub ``__init__.pyi`` next to the ``__init__.py`` of a package lists its public names. Type
checkers read the stub, and `attach_stub` derives the imports from it (Scientific Python, SPEC 1).
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from flightmech.errors import AeromatchWarning

PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
_FOLDER = Path(__file__).resolve().parents[2]


def hidden_packages() -> dict[str, str]:
    """Return our packages that are hidden by another package of the same name.

    Returns
    -------
    dict of str to str
        By the name of the package, the file from which Python would import it.
    """
    hidden = {}
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec else None
        if origin is None or Path(origin).resolve().parents[1] != _FOLDER:
            # a namespace package has no file
            hidden[name] = origin or "a folder without __init__.py"
    return hidden


def describe_hidden_packages(hidden: dict[str, str]) -> str:
    """Return a sentence on the result of `hidden_packages`, with the remedy."""
    places = ", ".join(f"{name!r} from {origin}" for name, origin in hidden.items())
    remedy = "rename or remove what hides it, or install aeromatch in an environment of its own"
    return f"Python would import {places}, not from {_FOLDER}; {remedy}"


def warn_if_hidden() -> None:
    """Warn if a package of this distribution is hidden.

    Warns
    -----
    AeromatchWarning
        With the package and the file from which Python would import it.
    """
    if hidden := hidden_packages():
        warnings.warn(describe_hidden_packages(hidden), AeromatchWarning, stacklevel=3)


def attach_stub(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, derived from its stub.

    Parameters
    ----------
    package : str
        Name of the package, ``__name__``.
    file : str
        Its ``__init__.py``, ``__file__``. The stub ``__init__.pyi`` is in the same folder.

    Raises
    ------
    ImportError
        The stub is missing, so that the installation is incomplete.
    ValueError
        A statement of the stub is not a relative import.

    Examples
    --------
    >>> import flightmech
    >>> getattr_, dir_, names = attach_stub("flightmech", flightmech.__file__)
    >>> names[:3]
    ['Aircraft', 'SimModel', 'air']
    """
    stub = Path(file).with_suffix(".pyi")
    sources = _read_stub(stub)
    names = sorted(sources)
    _Namespaces.stubs[package] = stub, sources

    def load(name: str) -> Any:
        if name not in sources:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}; public are {', '.join(names)}"
            )
        source, original_name = sources[name]
        path, is_module = _find_module(stub, original_name, source)
        module = importlib.import_module(f"{package}.{path}")
        return module if is_module else getattr(module, original_name)

    return load, lambda: names, names


class _Namespaces(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finder of public modules whose file is in a subfolder of the package.

    ``from flighttest.signals import x`` works although ``signals`` is inside another folder.
    """

    # by package: its stub, and by public name the module and the name in that module
    stubs: ClassVar[dict[str, tuple[Path, dict[str, tuple[str, str]]]]] = {}

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Return a spec if the name is a public module that the other finders do not find."""
        package, _, short_name = name.rpartition(".")
        stub, sources = self.stubs.get(package, (Path(), {}))
        if short_name not in sources:
            return None
        source, original_name = sources[short_name]
        _, is_module = _find_module(stub, original_name, source)
        return importlib.machinery.ModuleSpec(name, self) if is_module else None

    def create_module(self, spec: Any) -> Any:
        """Return the imported module of the public name.

        The import system then replaces the spec of the module; `exec_module` restores it.
        """
        package, _, short_name = spec.name.rpartition(".")
        stub, sources = self.stubs[package]
        source, original_name = sources[short_name]
        path, _ = _find_module(stub, original_name, source)
        module = importlib.import_module(f"{package}.{path}")
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: Any) -> None:
        """Restore the spec of the module. Its code is not executed a second time."""
        module.__spec__ = module.__spec__.loader_state


# appended at the end: the finder of files comes first
sys.meta_path.append(_Namespaces())


def public_names(stub: Path) -> dict[str, tuple[str, bool]]:
    """Return the public names of a stub.

    Returns
    -------
    dict of str to (str, bool)
        Module of each name, relative to the package, and whether the name is a module itself.
    """
    sources = _read_stub(stub)
    return {name: _find_module(stub, inner, module) for name, (module, inner) in sources.items()}


def _find_module(stub: Path, name: str, module: str) -> tuple[str, bool]:
    """Return the module to import for a name, and whether the name is a module itself."""
    folder = stub.parent.joinpath(*module.split("."))
    is_module = (folder / f"{name}.py").is_file() or (folder / name / "__init__.py").is_file()
    if not is_module:
        return module, False
    return f"{module}.{name}" if module else name, True


def _read_stub(stub: Path) -> dict[str, tuple[str, str]]:
    """Return by public name the module that it is imported from, and its name in the module."""
    try:
        tree = ast.parse(stub.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ImportError(
            f"{stub} is missing: it lists the public names of the package; install the "
            f"package again"
        ) from error
    sources = {}
    for node in tree.body:
        if isinstance(node, ast.Expr):
            # the docstring
            continue
        if not isinstance(node, ast.ImportFrom) or node.level != 1:
            raise ValueError(
                f"{stub}, line {node.lineno}: allowed are relative imports, 'from .module "
                f"import name as name'"
            )
        for item in node.names:
            # "from . import x" has no module
            sources[item.asname or item.name] = node.module or "", item.name
    return sources
