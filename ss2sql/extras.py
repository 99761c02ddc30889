"""Optional packages, and the command that installs them."""

from __future__ import annotations

# The same as the extras of pyproject.toml, which `pip install -e ".[sim]"` in a checkout installs.
PACKAGES = {
    "sim": "pybullet",
    "mujoco": "mujoco",
    "df": "pyarrow pandas polars",
    "plot": "matplotlib networkx",
    "repl": "prompt_toolkit pygments",
    "jupyter": "ipython jupyter",
    "duckdb": "duckdb pyarrow",
    "spark": "pyspark pyarrow pandas",
}


def install_line(extra: str) -> str:
    """The command that installs what an extra stands for, wherever ss2sql itself came from; of ODE what Debian has.

    >>> install_line("sim")
    'pip install pybullet'
    """
    if extra == "ode":
        return "apt-get install python3-pyode, and use the Python of the same release of Debian"
    return f"pip install {PACKAGES[extra]}"
