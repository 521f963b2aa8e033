"""./run vmtest: the appliance's packages in a virtual machine, on drivers of the kernel's.

usage: vmtest.py --image DIR --tools DIR --work DIR [--accel kvm|tcg] [--seed N]

DIR: what `image` made; the programs that were built; where to work.
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

GUEST_TOOLS = ("vm_feed", "vm_ring", "device_kms", "device_gpio", "device_keyboard")
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


def run_checks(report, machine, appliance, arguments, shots):
    tools = arguments.tools
    if not report.run("boots, root read only, no unit failed",
                      check_system.comes_up_on_a_read_only_root, appliance):
        report.note("journal: " + appliance.run("journalctl -p warning -b --no-pager | tail -15")[1])
    if appliance.slow:
        appliance.set_watchdogs(patient=True)
    report.run("frames arrive bit-exact, in order", check_devices.frames_arrive_bit_exact, appliance)
    report.run("buttons and LEDs", check_appliance.buttons_and_lamps_work, appliance)
    scene = (report.run("calibrates", check_appliance.calibrates_from_the_button, appliance, shots)
             and report.run("captures, reconstructs, shows",
                            check_appliance.captures_and_reconstructs_from_the_button, appliance,
                            shots))
    if scene:
        report.run("screen is what render renders", check_appliance.shows_what_render_renders,
                   appliance, shots, tools)
    report.run("units' exposure", check_system.units_are_locked_down, appliance)
    if scene:
        cuts = powercut.Cuts(machine, tools, arguments.work, arguments.seed)
        logged = report.run("reconstructs and saves, its disk logged", powercut.work_under_cuts,
                            appliance, cuts)
        report.run("killed capture daemon", check_devices.viewer_survives_killed_capture, appliance)
    report.run("camera unplugged", check_devices.camera_comes_back, appliance)
    report.run("libcamera", check_devices.libcamera_captures, appliance)
    report.run("device tests", check_devices.device_tests_pass, appliance)
    report.run("log is clean", check_system.log_is_clean, appliance)
    if scene and logged:
        report.run("power cuts while saving and reconstructing", powercut.finish, cuts)
    report.run("packages purge and install", check_system.packages_purge_and_install, appliance)


def main():
    parser = argparse.ArgumentParser()
    for name in ("--image", "--tools", "--work"):
        parser.add_argument(name, type=Path, required=True)
    parser.add_argument("--accel", choices=("kvm", "tcg"))
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
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
        run_checks(report, machine, appliance, arguments, shots)
        (arguments.work / "journal.txt").write_text(appliance.run("journalctl -b --no-pager")[1])
    except MachineError as fault:
        report.run("the machine", fail, fault)
    finally:
        machine.stop()
    return report.sum_up()


def fail(fault):
    raise fault


if __name__ == "__main__":
    sys.exit(main())
