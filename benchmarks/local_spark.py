"""Spark on this machine, for benchmarks."""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any


def local_spark(cores: int, **settings: str) -> Any:
    """A session with so many cores, with as many parts of a table; and with further settings."""
    warnings.simplefilter("ignore", FutureWarning)  # pyspark about packages that are newer than itself
    from pyspark.sql import SparkSession

    os.environ["PYSPARK_PYTHON"] = sys.executable
    builder = SparkSession.builder.appName("benchmark").master(f"local[{cores}]")
    usual = {
        "spark.ui.enabled": "false",
        "spark.ui.showConsoleProgress": "false",
        "spark.sql.shuffle.partitions": str(cores),
        "spark.log.level": "OFF",
    }
    for name, value in {**usual, **settings}.items():
        builder = builder.config(name, value)
    return builder.getOrCreate()
