"""Public names that are loaded when they are first used, so that importing a package is fast.

The stub ``__init__.pyi`` next to a package's ``__init__.py`` is the one table of its public names:
type checkers read it as it is, and `attach_stub` derives the loading from it (the pattern of
Scientific Python's SPEC 1).
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
    """Return the packages that another one of the same name hides.

    Returns
    -------
    dict of str to str
        Name, and where Python would import it from.
    """
    found = {}
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec else None
        if origin is None or Path(origin).resolve().parents[1] != _FOLDER:
            found[name] = origin or "a folder without __init__.py"
    return found


def describe_hidden_packages(hidden: dict[str, str]) -> str:
    """Return what `hidden_packages` found as a sentence with the remedy."""
    places = ", ".join(f"{name!r} from {origin}" for name, origin in hidden.items())
    remedy = "rename or remove what hides it, or install aeromatch in an environment of its own"
    return f"Python would import {places}, not from {_FOLDER}; {remedy}"


def warn_if_hidden() -> None:
    """Warn when a package of this distribution is hidden.

    Warns
    -----
    AeromatchWarning
        Names the package and where Python would import it from.
    """
    if hidden := hidden_packages():
        warnings.warn(describe_hidden_packages(hidden), AeromatchWarning, stacklevel=3)


def attach_stub(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package as its stub lists them.

    Parameters
    ----------
    package : str
        Name of the package, ``__name__``.
    file : str
        Its ``__init__.py``, ``__file__``; the stub is its neighbour ``__init__.pyi``.

    Raises
    ------
    ImportError
        The stub is missing: the installation is incomplete.
    ValueError
        A statement of the stub is no relative import.

    Examples
    --------
    >>> import flightmech
    >>> getattr_, dir_, names = attach_stub("flightmech", flightmech.__file__)
    >>> names[:3]
    ['Aircraft', 'SimModel', 'air']
    """
    stub = Path(file).with_suffix(".pyi")
    home = _imports(stub)
    names = sorted(home)
    _Namespaces.homes[package] = stub, home

    def load(name: str) -> Any:
        if name not in home:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}; public are {', '.join(names)}"
            )
        where, own = home[name]
        path, is_module = _place(stub, own, where)
        module = importlib.import_module(f"{package}.{path}")
        return module if is_module else getattr(module, own)

    return load, lambda: names, names


class _Namespaces(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Let ``from flighttest.signals import x`` find a namespace that is inside another folder."""

    homes: ClassVar[dict[str, tuple[Path, dict[str, tuple[str, str]]]]] = {}

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Return a spec for a public namespace that is not a folder of its package itself."""
        package, _, own = name.rpartition(".")
        stub, home = self.homes.get(package, (Path(), {}))
        if own not in home or not _place(stub, home[own][1], home[own][0])[1]:
            return None
        return importlib.machinery.ModuleSpec(name, self)

    def create_module(self, spec: Any) -> Any:
        """Return the module that has the namespace; its own spec is put back by `exec_module`."""
        package, _, own = spec.name.rpartition(".")
        stub, home = self.homes[package]
        module = importlib.import_module(f"{package}.{_place(stub, home[own][1], home[own][0])[0]}")
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: Any) -> None:
        """Nothing is executed again."""
        module.__spec__ = module.__spec__.loader_state


sys.meta_path.append(_Namespaces())  # the last: real modules come first


def public_names(stub: Path) -> dict[str, tuple[str, bool]]:
    """Return the public names of a stub: the module of each, relative to the package, and whether
    the name is that module itself.
    """
    return {name: _place(stub, own, module) for name, (module, own) in _imports(stub).items()}


def _place(stub: Path, name: str, module: str) -> tuple[str, bool]:
    """Return where a name is; whether it is a module itself takes a look at the disk."""
    folder = stub.parent.joinpath(*module.split("."))
    is_module = (folder / f"{name}.py").is_file() or (folder / name / "__init__.py").is_file()
    return ".".join(filter(None, (module, name if is_module else ""))), is_module


def _imports(stub: Path) -> dict[str, tuple[str, str]]:
    """Return the public names of a stub: the module that each is imported from, and its name there."""
    try:
        tree = ast.parse(stub.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ImportError(
            f"{stub} is missing: it lists the public names of the package; install the "
            f"package again"
        ) from error
    home = {}
    for node in tree.body:
        if isinstance(node, ast.Expr):
            continue  # the docstring
        if not isinstance(node, ast.ImportFrom) or node.level != 1:
            raise ValueError(
                f"{stub}, line {node.lineno}: allowed are relative imports, 'from .module "
                f"import name as name'"
            )
        home.update(
            {item.asname or item.name: (node.module or "", item.name) for item in node.names}
        )
    return home
