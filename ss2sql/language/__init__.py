"""What every other room speaks: values, types, the plan, the operations, and what a representation is given.

Values: values, conversion (from Python's objects). Types: kinds, column_shapes. The plan: plan,
plan_traversal. Rows: rows, area_grid, area_arguments. Around a run: cancellation.
"""
