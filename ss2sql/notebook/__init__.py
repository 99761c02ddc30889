"""SelectScript in notebooks: `%load_ext ss2sql` gives the magics `%%ss` and `%ss`.

`magic` is the magics, `options` reads their first line, `names` finds what a script means by names of the notebook,
`endings` has errors shown as messages. Only this package imports IPython.
"""

from __future__ import annotations

from typing import Any


def load_ipython_extension(shell: Any) -> None:
    """What `%load_ext ss2sql` calls."""
    from ss2sql.notebook.magic import ScriptMagics

    shell.register_magics(ScriptMagics(shell))


def unload_ipython_extension(shell: Any) -> None:
    """What `%unload_ext ss2sql` calls: the magics are gone, and the session that was theirs is closed."""
    from ss2sql.notebook.magic import ScriptMagics

    magics = shell.magics_manager.registry.pop(ScriptMagics.__name__, None)
    for kind in ("line", "cell"):
        shell.magics_manager.magics[kind].pop("ss", None)
    if magics is not None:
        magics.close()
