"""Power cuts: the disk as it may be at any moment, made of the log of its writes and flushes.

What a disk holds after a power cut is all that was written before the last flush, and of what was
written since whatever the disk got round to. For each cut an image is made of just that: every
write before the last flush, and of those after it each is there, is not, or ends at some sector,
as dice fall. A reset of the machine would be kinder: it keeps all that reached the disk's cache.
"""
import configparser
import json
import os
import random
import shutil
import struct
import subprocess
import time
from pathlib import Path
from queue import Empty, Queue
from threading import Thread

from report import Failure, expect

CUTS = 50
ROUNDS = 2
SECTOR = 512
FLUSH, DISCARD = 1, 4
MAGIC = 0x6A736677736872
PATIENCE_S = 90


class WriteLog:
    """What dm-log-writes calls a log, as QEMU's blklogwrites writes it."""

    def __init__(self, path):
        self.bytes = Path(path).read_bytes()
        magic, version, _, sector_bytes = struct.unpack_from("<QQQI", self.bytes)
        if (magic, version, sector_bytes) != (MAGIC, 1, SECTOR):
            raise Failure(f"{path}: is no log of writes")
        self.entries = []  # (sector on the disk, sectors, flags, place of the data in the log)
        at = SECTOR
        while at + SECTOR <= len(self.bytes):
            sector, count, flags, _ = struct.unpack_from("<QQQQ", self.bytes, at)
            if (sector, count, flags) == (0, 0, 0):
                break
            at += SECTOR
            self.entries.append((sector, count, flags, at))
            at += 0 if flags & DISCARD else count * SECTOR

    def apply(self, image, index, sectors=None):
        """Put a write on an image, or only its first sectors."""
        sector, count, flags, at = self.entries[index]
        if flags & DISCARD:
            return
        size = (count if sectors is None else sectors) * SECTOR
        image[sector * SECTOR:sector * SECTOR + size] = self.bytes[at:at + size]

    def last_flush(self, cut):
        return max((i for i in range(cut) if self.entries[i][2] & FLUSH), default=-1)

    def entries_before(self, size):
        """How many entries had been written when the log was so large."""
        return sum(at - SECTOR < size for _, _, _, at in self.entries)


class Cuts:
    """Moments to look at, and what must be so from which moment on."""

    def __init__(self, machine, tools, work, seed):
        self.log_path, self.first = machine.log, machine.folder / "data-first.img"
        self.tools, self.work = tools, work / "cuts"
        self.random = random.Random(seed)
        self.start = 0  # of the log, when the work began
        self.facts = []  # (size of the log, name of what is saved or "" for the scene)
        self.results = Queue()

    def mark(self):
        return self.log_path.stat().st_size

    def note(self, fact):
        self.facts.append((self.mark(), fact))


def work_under_cuts(appliance, cuts):
    """Have the appliance reconstruct and save while its disk is logged."""
    cuts.note("")  # a scene is there
    cuts.start = cuts.mark()
    for i in range(ROUNDS):
        appliance.must("diorama ctl reconstruct")
        appliance.wait_for("State=view", 120)
        cuts.note("")
        appliance.must(f"diorama ctl save round-{i}")
        cuts.note(f"round-{i}")
    cuts.thread = Thread(target=look_at_cuts, args=(cuts,), daemon=True)
    cuts.thread.start()
    return f"{ROUNDS} reconstructions, {ROUNDS} saves, {(cuts.mark() - cuts.start) >> 20} MiB written"


def make_images(cuts, log):
    """(cut, image file) for each moment, from the first to the last."""
    begin = log.entries_before(cuts.start)
    moments = sorted(cuts.random.sample(range(begin, len(log.entries) + 1), CUTS))
    image = bytearray(cuts.first.read_bytes())
    done = 0
    for number, cut in enumerate(moments):
        flush = log.last_flush(cut)
        while done <= flush:
            log.apply(image, done)
            done += 1
        torn = bytearray(image)
        for i in range(flush + 1, cut):
            dice = cuts.random.random()
            if dice < 0.5:
                log.apply(torn, i)
            elif dice < 0.75:
                log.apply(torn, i, cuts.random.randrange(log.entries[i][1] + 1))
        path = cuts.work / f"cut-{number}.img"
        path.write_bytes(torn)
        yield cut, cut - flush - 1, path


def look_at_cuts(cuts):
    """On a thread of its own: what comes of each cut goes into `results`."""
    try:
        shutil.rmtree(cuts.work, ignore_errors=True)
        cuts.work.mkdir()
        log = WriteLog(cuts.log_path)
        facts = [(log.entries_before(size), fact) for size, fact in cuts.facts]
        with PrivateBus(cuts.work) as bus:
            for cut, loose, path in make_images(cuts, log):
                cuts.results.put((cut, loose, look_at(cuts, path, bus, [
                    fact for at, fact in facts if at <= cut])))
    except Exception as fault:  # told by finish()
        cuts.results.put((-1, 0, f"{fault}"))


def finish(cuts):
    """Wait for the thread and sum up."""
    cuts.thread.join()
    results = []
    while True:
        try:
            results.append(cuts.results.get_nowait())
        except Empty:
            break
    broken = [(cut, fault) for cut, _, fault in results if isinstance(fault, str)]
    expect(not broken, f"{len(broken)} of {CUTS} broken, as after write {broken[0][0]}: "
           f"{broken[0][1]}" if broken else "")
    expect(len(results) == CUTS, f"{len(results)} cuts of {CUTS} were looked at")
    resumed = sum(result["resumed"] for _, _, result in results)
    saved = sum(result["saved"] for _, _, result in results)
    loose = sum(count > 0 for _, count, _ in results)
    return (f"{CUTS} moments over {ROUNDS} reconstructions and saves, {loose} with unflushed writes "
            f"torn or lost: 0 broken scenes, {saved} saved ones whole, {resumed} reconstructions "
            "taken up again")


class PrivateBus:
    def __init__(self, work):
        self.address = f"unix:path={work.resolve()}/bus"

    def __enter__(self):
        self.process = subprocess.Popen(["dbus-daemon", "--session", "--nofork", "--nopidfile",
                                         f"--address={self.address}"], stderr=subprocess.DEVNULL)
        return self.address

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


def make_profile(state):
    """The machine's own profile for a viewer on the host: no devices, its files in `state`."""
    root = Path(__file__).resolve().parents[2]
    own, profile = configparser.ConfigParser(), configparser.ConfigParser()
    own.read(root / "board" / "vm.ini")
    profile["capture"] = own["capture"]
    profile["engine"] = {**own["engine"], "threads": "1",
                         "model": str(root / "models" / "diorama-s.safetensors")}
    profile["display"] = {"output": "none"}
    profile["paths"] = {"state": str(state), "runtime": str(state)}
    with open(state / "board.ini", "w") as file:
        profile.write(file)
    return state / "board.ini"


def look_at(cuts, image, bus, facts):
    """Mend the file system as a boot does, take the files out, start the viewer on them."""
    state = image.with_suffix("")
    try:
        checked = subprocess.run(["e2fsck", "-fp", image], capture_output=True, text=True)
        if checked.returncode > 1:
            return f"the file system is broken: {checked.stdout.strip()[-300:]}"
        state.mkdir()
        subprocess.run(["debugfs", "-R", f"rdump / {state}", image], capture_output=True)
        saved = check_saved(cuts, state, [fact for fact in facts if fact])
        due = any(state.glob("captures/*/reconstruct.due"))
        return {"saved": saved, "resumed": due, **check_viewer(cuts, state, bus)}
    except Failure as fault:
        return str(fault)
    finally:
        image.unlink()
        shutil.rmtree(state, ignore_errors=True)


def check_saved(cuts, state, names):
    """Every scene under scenes/ is whole, and those that were acknowledged are there."""
    there = [folder for folder in state.glob("scenes/*") if not folder.name.startswith(".")]
    missing = set(names) - {folder.name for folder in there}
    expect(not missing, f"saved and acknowledged, but gone: {sorted(missing)}")
    for folder in there:
        for name in ("scene.safetensors", "scene.json"):
            info = subprocess.run([cuts.tools / "diorama", "info", folder / name],
                                  capture_output=True, text=True)
            expect(info.returncode == 0, f"{folder.name}: {info.stderr.strip()}")
        for frame in json.loads((folder / "scene.json").read_text())["frames"]:
            picture = folder / frame["file"]
            expect(picture.exists() and picture.read_bytes().endswith(b"IEND\xaeB`\x82"),
                   f"{folder.name}: {frame['file']} is cut off")
    return len(there)


def check_viewer(cuts, state, bus):
    """The display daemon opens what is there, takes up what was under way, and shows a scene."""
    profile = make_profile(state.resolve())
    environment = dict(os.environ, DIORAMA_BUS=bus)
    with open(state / "log", "w+") as log:
        viewer = subprocess.Popen([cuts.tools / "diorama-viewd", "--profile", profile, "--bus", bus],
                                  stderr=log)
        try:
            deadline, waited = time.monotonic() + PATIENCE_S, None
            while time.monotonic() < deadline and viewer.poll() is None:
                waited = subprocess.run([cuts.tools / "diorama", "ctl", "--timeout", "20", "wait",
                                         "State=view"], capture_output=True, text=True,
                                        env=environment)
                if waited.returncode == 0:
                    break
                time.sleep(0.05)
        finally:
            viewer.terminate()
            code = viewer.wait()
        log.seek(0)
        said = log.read()
    expect(waited and waited.returncode == 0, f"no scene is shown ({code}): {said.strip()[-300:]}")
    for line in said.splitlines():
        expect("damaged" not in line and "scene.safetensors" not in line, line)
    return {}
