"""Drawer closing: push an open drawer shut."""

from collectors.tasks.drawer import BAR, GAP, HANDLE_Z, DrawerTask
from collectors.tasks.gripper import Gripper, Moves

SHUT = 0.02  # [m] to be undercut (reference benchmark)
TOUCH = GAP + BAR + 0.01  # [m] before the front: the TCP when the fingers touch the handle
BEFORE = TOUCH + 0.012  # [m] before the front: where the gripper comes down
PUSH_Z = HANDLE_Z - 0.003  # [m]


class DrawerClosing(DrawerTask):
    """Close a drawer of varying place and direction that is open by 10 cm."""

    opened = 0.10

    def success(self) -> bool:
        """The drawer is open by less than 2 cm."""
        return self.opening < SHUT

    def expert(self, gripper: Gripper) -> Moves:
        """Down before the handle, push; again if the fingers slide off it or it moves away."""
        while True:
            across = gripper.noise * gripper.rng.uniform(-0.04, 0.04)
            yield from self.reach(gripper, BEFORE, across, PUSH_Z)
            yield from gripper.go(*self.at(TOUCH - self.opening, across), until=lambda: not self._before())

    def _before(self) -> bool:
        """Whether the fingers are before the handle, or press on it."""
        along, across, up = self.gripper_at()
        return TOUCH - 0.01 < along < BEFORE + 0.015 and abs(across) < 0.07 and up < PUSH_Z + 0.015
