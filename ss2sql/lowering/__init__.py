"""From the plan to SQL: one `plan.Query` in, one `SqlQuery` out, or an `UnsupportedError` with the reason.

In order of control flow: `rewrites/` come first; unsupported decides; lower makes the statement: flat and join with
from_clause for flat queries; recursive_query, search, search_step, union_branches and strategies for
searches; evaluation_order for both. Expressions: sqlite_expressions, sqlite_forms, equality. The text:
statement_needs, sql_query, sql_builder. `portable/` writes SQL for other databases.
"""
