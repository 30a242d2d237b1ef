"""Household picking with objects that no demonstration of `HouseholdPicking` has."""

from collectors.tasks.household_picking import HouseholdPicking


class HouseholdPickingHeldout(HouseholdPicking):
    """Household picking with the fifth of the objects that is kept for tests. All else is as in `HouseholdPicking`."""

    part = "test"
