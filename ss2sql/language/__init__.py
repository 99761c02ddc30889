"""What every other room speaks: values, types, the plan, the operations, and what a representation is given.

Values: values, conversion (from Python's objects). Types: kinds. The plan: plan, plan_traversal.
Rows and representations: rows, area_grid. Around a run: cancellation.
"""
