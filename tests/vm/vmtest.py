"""./run vmtest: the appliance's packages in a virtual machine, on drivers of the kernel's.

usage: vmtest.py --image DIR --tools DIR --work DIR [--accel kvm|tcg] [--seed N] [soak]

DIR: what `image` made; the programs that were built; where to work. With `soak` the run that looks
for growth lasts ten minutes and is the only one beside what it needs.
"""
import argparse
import hashlib
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

sys.dont_write_bytecode = True  # nothing is left beside the sources

import check_appliance
import check_devices
import check_system
import powercut
from appliance import DANCE, FRAME_BYTES, FRAME_COUNT, NOISE, WALK, Appliance
from machine import Machine, MachineError, kvm_works
from report import Report

GUEST_TOOLS = ("vm_feed", "vm_ring", "vm_camera", "device_kms", "device_gpio", "device_keyboard")
SOAK_S, SHORT_S = 600, 30
SIM = "sim:table?seed=7&style={style}&fps={fps}"


def make_frames(tools, path, keep):
    """Noise, then the simulated table from the way a hand shows a board and from a walk round it."""
    program = tools / "vm_frames"
    key = hashlib.sha256(program.read_bytes()).hexdigest()[:12]
    kept = keep / f"frames-{key}.yuyv"
    if not kept.exists():
        for old in keep.glob("frames-*.yuyv*"):
            old.unlink()
        part = kept.with_suffix(".part")
        with open(part, "wb") as file:
            file.write(random.Random(1).randbytes(NOISE[1] * FRAME_BYTES))
            file.flush()
            for style, fps, frames in (("dance", 0.66667, DANCE), ("walk", 1, WALK)):
                subprocess.run([program, SIM.format(style=style, fps=fps), str(frames[1])],
                               stdout=file, check=True)
        part.rename(kept)
    assert kept.stat().st_size == FRAME_COUNT * FRAME_BYTES
    shutil.copyfile(kept, path)


def keep_journal(appliance, path):
    """The journal lives in memory: a reset loses it."""
    path.write_text(appliance.run("journalctl --no-pager")[1])


def run_checks(report, machine, appliance, arguments, shots, boot_s):
    tools = arguments.tools
    if not report.run("boots, root read only, no unit failed",
                      check_system.comes_up_on_a_read_only_root, appliance):
        report.note("journal: " + appliance.run("journalctl -p warning -b --no-pager | tail -15")[1])
    hung = check_system.hang_viewer(appliance)  # the next check does without it
    report.run("frames arrive bit-exact, in order", check_devices.frames_arrive_bit_exact, appliance)
    report.run("hung viewer", check_system.watchdog_restarts_a_hung_viewer, appliance, hung)
    if appliance.slow:
        appliance.set_watchdogs(patient=True)
    report.run("buttons and LEDs", check_appliance.buttons_and_lamps_work, appliance)
    scene = (report.run("calibrates", check_appliance.calibrates_from_the_button, appliance, shots)
             and report.run("captures, reconstructs, shows",
                            check_appliance.captures_and_reconstructs_from_the_button, appliance,
                            shots))
    if arguments.what == "soak":
        report.run("nothing grows", check_system.nothing_grows, appliance, SOAK_S)
        return
    if scene:
        report.run("screen is what render renders", check_appliance.shows_what_render_renders,
                   appliance, shots, tools)
        cuts = powercut.Cuts(machine, tools, arguments.work, arguments.seed)
        logged = report.run("reconstructs and saves, its disk logged", powercut.work_under_cuts,
                            appliance, cuts)
        report.run("nothing grows", check_system.nothing_grows, appliance, SHORT_S)
        report.run("killed capture daemon", check_devices.viewer_survives_killed_capture, appliance)
    report.run("injected faults", check_devices.faults_are_survived, appliance)
    report.run("sizes, formats, buffers at their edges", check_devices.abuse_at_the_edges, appliance)
    report.run("camera unplugged", check_devices.camera_comes_back, appliance)
    report.run("libcamera", check_devices.libcamera_captures, appliance)
    report.run("device tests", check_devices.device_tests_pass, appliance)
    report.run("units' exposure", check_system.units_are_locked_down, appliance)
    report.run("log is clean", check_system.log_is_clean, appliance)
    if scene and logged:
        report.run("power cuts while saving and reconstructing", powercut.finish, cuts)
    if scene:
        keep_journal(appliance, arguments.work / "journal-first.txt")
        report.run("power cut of the whole box", check_system.comes_back_after_a_reset, appliance,
                   boot_s)
    report.run("packages purge and install", check_system.packages_purge_and_install, appliance)


def main():
    parser = argparse.ArgumentParser()
    for name in ("--image", "--tools", "--work"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--accel", choices=("kvm", "tcg"))
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
    parser.add_argument("what", nargs="?", choices=("soak",))
    arguments = parser.parse_args()

    # The machine must not outlive us.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    shots, share = arguments.work / "shots", arguments.work / "share"
    for folder in (shots, share):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    if not shutil.which("qemu-system-x86_64"):
        sys.exit("vmtest: qemu-system-x86_64 is missing: ./run vmtest installs it")
    accelerator = arguments.accel or ("kvm" if kvm_works(arguments.image) else "tcg")
    report = Report()
    print(f"vmtest: {'KVM' if accelerator == 'kvm' else 'emulation (no working KVM here)'}, "
          f"seed {arguments.seed}; logs and screenshots in {arguments.work}", flush=True)
    make_frames(arguments.tools, share / "frames.yuyv", arguments.image)
    for name in GUEST_TOOLS:
        shutil.copy(arguments.tools / name, share)
    machine = Machine(arguments.image, arguments.work, share, accelerator)
    boot_s = 60 if accelerator == "kvm" else 300
    try:
        machine.make_data_disk()
        machine.start()
        machine.wait_boot(boot_s)
        appliance = Appliance(machine)
        run_checks(report, machine, appliance, arguments, shots, boot_s)
        keep_journal(appliance, arguments.work / "journal.txt")
    except MachineError as fault:
        report.run("the machine", fail, fault)
    finally:
        machine.stop()
    return report.sum_up()


def fail(fault):
    raise fault


if __name__ == "__main__":
    sys.exit(main())
