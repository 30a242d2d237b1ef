"""Household picking with the objects that demonstrations never show."""

from collectors.tasks.household_picking import HouseholdPicking


class HouseholdPickingHeldout(HouseholdPicking):
    """The fifth of the objects that is kept for tests; everything else is the same."""

    part = "test"
