"""Drawer opening: hook the handle and pull the drawer open."""

from collectors.tasks.drawer import GAP, HANDLE_Z, DrawerTask
from collectors.tasks.gripper import Gripper, Moves

OPEN = 0.10  # [m] opening above which the drawer counts as open (reference benchmark)
HOOK = 0.023  # [m] from the drawer's front to the TCP, in the gap: the fingers are 6 mm from touching the handle
HOOK_Z = HANDLE_Z - 0.008  # [m] height of the pulling TCP: the fingertips are 7 mm lower, the palm is 40 mm higher


class DrawerOpening(DrawerTask):
    """Task to open a closed drawer of varying place and direction by 10 cm."""

    opened = 0.0

    def success(self) -> bool:
        """Return whether the drawer is open by more than 10 cm."""
        return self.opening > OPEN

    def expert(self, gripper: Gripper) -> Moves:
        """Yield actions that go down into the gap behind the handle and pull.

        The expert starts again if the fingers do not catch the handle or lose it.

        Args:
            gripper: Gripper of the task's world, which makes the actions.
        """
        while True:
            across = gripper.noise * gripper.rng.uniform(-0.02, 0.02)
            yield from self.reach(gripper, HOOK, across, HOOK_Z)
            far = HOOK + OPEN + 0.03 - self.opening
            yield from gripper.go(*self.at(far, across), until=lambda: not self._hooked())

    def _hooked(self) -> bool:
        """Return whether the fingers are behind the handle."""
        along, across, up = self.gripper_at()
        return 0.0 < along < GAP and abs(across) < 0.05 and up < HOOK_Z + 0.012
