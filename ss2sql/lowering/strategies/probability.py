"""Most likely first: the waiting step whose path has the greatest product of probabilities."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "probability",
    "PROBABILITY",
    (("likelihood", True), ("step", False)),
    "Gives likelier paths before less likely ones.",
    "likelihood",
)
