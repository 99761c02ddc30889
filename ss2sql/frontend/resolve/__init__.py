"""From the syntax tree to the plan: names are bound, calls checked, types and volatility computed.

In order of control flow: catalog (what exists), resolver (expressions), query_clauses (queries), from_clause, scope,
search_clauses, path_functions, grouping, suggestions.
"""
