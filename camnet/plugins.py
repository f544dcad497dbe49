"""Parts from other packages by name, ``module:attribute``: estimators, agents and readers of tracks.

The module is imported as Python finds it: from an installed package, or from a folder on ``PYTHONPATH``.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from typing import Any

from camnet.errors import ConfigError

__all__ = ["PATTERN", "is_plugin", "load_plugin"]

#: what a name looks like
PATTERN = r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*$"


def is_plugin(name: str) -> bool:
    """Whether a name is of the form ``module:attribute``."""
    return re.match(PATTERN, name) is not None


def load_plugin(name: str, field: str, words: str) -> Callable[..., Any]:
    """Return what ``name`` stands for.

    Parameters
    ----------
    name : ``module:attribute``
    field : where it was given, for messages: ``run.estimators``
    words : what it has to be, for messages: ``a function of (network, target) that returns an estimator``

    Raises
    ------
    ConfigError
        The module cannot be imported, has no such attribute, or it cannot be called.
    """
    module, _, attribute = name.partition(":")
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{field}: {name!r}: {error}; install the package that has it, or put its folder on PYTHONPATH"
        ) from None
    except Exception as error:  # whatever a module of somebody else raises
        raise ConfigError(
            f"{field}: {name!r}: {module} fails to load: {type(error).__name__}: {error}"
        ) from error
    if not hasattr(found, attribute):
        known = [n for n in vars(found) if not n.startswith("_") and callable(vars(found)[n])]
        raise ConfigError(
            f"{field}: {name!r}: {module} has no {attribute!r}; it has {', '.join(known) or 'nothing to call'}"
        )
    part = getattr(found, attribute)
    if not callable(part):
        raise ConfigError(f"{field}: {name!r} is {type(part).__name__}: {words} was expected")
    return part  # type: ignore[no-any-return]
