"""Searches by levels in tables of Spark. All files share one session of Spark, which ends behind the last of them."""
