"""Drawer closing: push an open drawer shut."""

from collectors.tasks.drawer import BAR, GAP, HANDLE_Z, DrawerTask
from collectors.tasks.gripper import Gripper, Moves

SHUT = 0.02  # [m] opening below which the drawer counts as closed (reference benchmark)
TOUCH = GAP + BAR + 0.01  # [m] from the drawer's front to the TCP when the fingers touch the handle
BEFORE = TOUCH + 0.012  # [m] from the drawer's front to the TCP where the gripper comes down
PUSH_Z = HANDLE_Z - 0.003  # [m] height of the pushing TCP


class DrawerClosing(DrawerTask):
    """Task to close a drawer of varying place and direction that is open by 10 cm."""

    opened = 0.10

    def success(self) -> bool:
        """Return whether the drawer is open by less than 2 cm."""
        return self.opening < SHUT

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that go down before the handle and push it.

        The expert starts again if the fingers slide off the handle or the handle moves away.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        while True:
            across = gripper.noise * gripper.rng.uniform(-0.04, 0.04)
            yield from self.reach(gripper, BEFORE, across, PUSH_Z)
            yield from gripper.go(*self.at(TOUCH - self.opening, across), until=lambda: not self._before())

    def _before(self) -> bool:
        """Return whether the fingers are just before the handle or press on it."""
        along, across, up = self.gripper_at()
        return TOUCH - 0.01 < along < BEFORE + 0.015 and abs(across) < 0.07 and up < PUSH_Z + 0.015
