"""From the syntax tree to the plan: names are bound, calls checked, types and volatility computed.

In order of control flow: scope (what exists and is visible), resolver (expressions), query_clauses (queries),
from_clause, search_clauses, grouping.
"""
