"""SpaceMouse that is read as a plain HID device, without a driver or software of the maker.

The reports are little-endian. Report 1 has the cap's translation (right, near, down) as three 16-bit numbers within
about +-350, report 2 its rotation likewise, and report 3 the buttons as bits. Newer devices put the rotation behind the
translation in report 1.
"""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.device import Device, DeviceLostError, reading, without_rest
from svfl_data.errors import CollectError

FULL = 350.0  # value of a full deflection
REST = 0.08  # fraction of a full deflection that counts as rest
MAKERS = (0x256F, 0x046D)  # vendor numbers of 3Dconnexion, and of Logitech, under which older ones are sold
REPORT = 64  # [bytes] read at once, longer than any report


class SpaceMouse(Device):
    """First SpaceMouse that is connected.

    Args:
        opened: Device of the kind that `hid.device` returns, which is open and does not block when it is read.
    """

    name = "spacemouse"
    controls = (
        ("cap", "push it where the gripper shall go"),
        ("twist", "turn"),
        ("left button", "open or close the gripper"),
    )

    def __init__(self, opened: Any) -> None:  # noqa: ANN401 - hidapi has no types
        self._hid = opened
        self._shift, self._twist = (0, 0, 0), 0
        self._buttons = 0
        self._open = True

    @classmethod
    def find(cls) -> "SpaceMouse":
        """Open the first SpaceMouse that is connected.

        Raises:
            CollectError: If no SpaceMouse is connected, or it may not be opened.
        """
        import hid

        connected = hid.enumerate()
        for found in connected:
            if is_spacemouse(found):
                opened = hid.device()
                try:
                    opened.open_path(found["path"])
                except OSError as error:
                    raise CollectError(
                        f"--input-device spacemouse: {found['product_string']} may not be opened; on Linux, a udev "
                        "rule gives access (docs/teleoperation.md)"
                    ) from error
                opened.set_nonblocking(True)
                return cls(opened)
        names = sorted({found["product_string"] or "unnamed" for found in connected})
        raise CollectError(
            "--input-device spacemouse: none is connected; found "
            + (", ".join(names) if names else "no HID device at all")
        )

    def read(self) -> NDArray[np.float32]:
        """Process all reports that have arrived, and return the state of the cap as a reading, (5,)."""
        try:
            while report := bytes(self._hid.read(REPORT)):
                self._take(report)
        except (OSError, ValueError) as error:
            raise DeviceLostError("the SpaceMouse was unplugged") from error
        right, near, down = (without_rest(max(-1.0, min(1.0, value / FULL)), REST) for value in self._shift)
        turn = without_rest(max(-1.0, min(1.0, self._twist / FULL)), REST)
        return reading(float(self._open), right, -near, -down, -turn)

    def _take(self, report: bytes) -> None:
        kind, body = report[0], report[1:]
        if kind == 1 and len(body) >= 6:
            self._shift = struct.unpack_from("<3h", body)
            if len(body) >= 12:
                self._twist = struct.unpack_from("<3h", body, 6)[2]
        elif kind == 2 and len(body) >= 6:
            self._twist = struct.unpack_from("<3h", body)[2]
        elif kind == 3 and body:
            if body[0] & ~self._buttons & 1:
                self._open = not self._open
            self._buttons = body[0]

    def begin(self, opened: bool) -> None:
        """Take over the state of the gripper at the start of an episode."""
        self._open = opened

    def close(self) -> None:
        """Release the SpaceMouse."""
        self._hid.close()


def is_spacemouse(found: dict[str, Any]) -> bool:
    """Return whether an HID device is a SpaceMouse, SpaceNavigator or SpacePilot, or the receiver of one.

    Args:
        found: Description of the device, from `hid.enumerate`.
    """
    name = (found["product_string"] or "").lower()
    own = found["vendor_id"] == MAKERS[0]
    return found["vendor_id"] in MAKERS and ("space" in name or (own and "receiver" in name))
