"""``python -m tests.hostile.table [KIND...] [--commands NAME,...]``: what breaks which law, as a table for a person."""

import argparse
import collections
import fnmatch
import sys
import tempfile
import time
from pathlib import Path

from tests.hostile.campaign import Campaign, in_turn, targets
from tests.hostile.commands import EVERY
from tests.hostile.kinds import KINDS
from tests.hostile.sound import sound_dataset


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kinds", nargs="*", default=["*"])
    parser.add_argument("--commands", default="*")
    parser.add_argument("--heavy", action="store_true")
    parser.add_argument("--turns", type=int, help="so many commands for each kind, in turn (default: all)")
    parser.add_argument("--stride", type=int, default=1, help="one kind in so many")
    parser.add_argument("--offset", type=int, default=0, help="the first kind")
    parser.add_argument("--show", action="store_true")
    arguments = parser.parse_args()
    chosen = [one for one in EVERY if any(fnmatch.fnmatch(one.name, p) for p in arguments.commands.split(","))]
    chosen = [one for one in chosen if arguments.heavy or not one.heavy]
    kinds = [one for one in KINDS if any(fnmatch.fnmatch(one.name, pattern) for pattern in arguments.kinds)]
    kinds = kinds[arguments.offset :: arguments.stride]
    with tempfile.TemporaryDirectory() as place:
        campaign = Campaign(Path(place), sound_dataset(Path(place) / "sound"))
        try:
            attack(campaign, kinds, chosen, arguments.show, arguments.turns)
        finally:
            campaign.close()


def attack(campaign, kinds, chosen, show, turns):
    counts = collections.Counter()
    most = {"cpu_s": (0.0, ""), "peak": (0, "")}
    for number, kind in enumerate(kinds):
        began = time.monotonic()
        try:
            campaign.prepare(kind)
        except Exception as error:
            print(f"{kind.name}\t-\tCANNOT BE MADE {type(error).__name__} {error}", flush=True)
            continue
        making = time.monotonic() - began
        for command in in_turn(number, kind, chosen, turns) if turns else targets(kind, chosen):
            if command.name not in campaign.peaks:
                ended = campaign.baseline(command)
                print(f"# sound {command.name}: {ended.code} {ended.cpu_s:.2f} s {ended.peak_bytes / 2**20:.0f} MB "
                      f"{ended.err.decode(errors='replace').strip()[-300:]}", flush=True)  # fmt: skip
                campaign.prepare(kind)
            ended, broken = campaign.attack(kind, command)
            counts["attacks"] += 1
            counts["refused"] += ended.code != 0
            counts["broken"] += bool(broken)
            where = f"{kind.name} {command.name}"
            most["cpu_s"] = max(most["cpu_s"], (ended.cpu_s, where))
            most["peak"] = max(most["peak"], (ended.peak_bytes - campaign.peaks[command.name], where))
            for words in broken:
                print(f"{kind.name}\t{command.name}\t{words}", flush=True)
            if show:
                print(
                    f"  {kind.name} {command.name} {ended.code} {ended.cpu_s:.2f}",
                    ended.err.decode(errors="replace").strip()[:300],
                )
        if number % 50 == 0:
            print(f"# {number} of {len(kinds)}: {kind.name}", flush=True)
        if making > 3 or time.monotonic() - began > 60:
            print(f"# {kind.name}: made in {making:.1f} s, all in {time.monotonic() - began:.1f} s", flush=True)
    print("#", dict(counts), most, file=sys.stdout)


if __name__ == "__main__":
    main()
