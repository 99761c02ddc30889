"""From the plan to SQL: one `plan.Query` in, one `SqlQuery` out, or an `UnsupportedError` with the reason.

In order of control flow: `rewrites/` come first; unsupported decides; lower makes the statement: flat and join with
from_clause, materialize and expression_index for flat queries; recursive_query, search, search_step, step_lookup,
union_branches and strategies for searches; evaluation_order for both. Expressions: sqlite_expressions, sqlite_forms,
operation_forms, equality, storage_class, element_calls, aggregate_subqueries, blob_index, blob_encoding,
scalar_replacement. The text: statement_needs, sql_query, sql_builder, sql_names, dialects, sql_string. `portable/`
writes SQL for other databases.
"""
