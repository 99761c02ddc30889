"""The Python engine: a plan in, a Python function of a run out.

native_query is what the rest of the package sees; it compiles the queries of one codegen_context: flat_query,
source_loops and source_lookups for flat queries; search_compiler, step_function and step_clauses for searches, with
step_inlining. python_expressions writes expressions; call_code and single_calls write calls, which run/calls makes;
codegen_context says what may be moved. Code is made as syntax trees in located_code, which finds the span of an
exception. At run time: query_execution, search_execution.
"""

from __future__ import annotations

from ss2sql.runtime.python.native_query import NativeQuery as NativeQuery
from ss2sql.runtime.python.native_query import compile_statement as compile_statement
