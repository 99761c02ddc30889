"""SelectScript in notebooks: `%load_ext ss2sql` gives the magics `%%ss` and `%ss`.

Only this room imports IPython.
"""

from __future__ import annotations

from typing import Any


def load_ipython_extension(shell: Any) -> None:
    """Called by `%load_ext ss2sql`."""
    from ss2sql.notebook.magics import ScriptMagics

    shell.register_magics(ScriptMagics(shell))


def unload_ipython_extension(shell: Any) -> None:
    """Called by `%unload_ext ss2sql`: removes the magics and closes their session."""
    from ss2sql.notebook.magics import ScriptMagics

    magics = shell.magics_manager.registry.pop(ScriptMagics.__name__, None)
    for kind in ("line", "cell"):
        shell.magics_manager.magics[kind].pop("ss", None)
    if magics is not None:
        magics.close_session()
