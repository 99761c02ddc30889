"""What every other room speaks: values, types, the plan, the operations, and what a representation is given.

Values: values, frozen_values, conversion (from Python's objects), ordering, element_columns, unreadable_text,
value_messages. Types: kinds, column_shapes, implied_bounds. The plan: plan, plan_sources, plan_traversal, plan_printer,
step_identity. Rows: rows, representation_table, area_grid, area_arguments. Around a run: cancellation, recursion_limit,
file_sources.
"""
