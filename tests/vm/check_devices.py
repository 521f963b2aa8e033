"""Camera, lines and display under real drivers."""
import re

from appliance import FRAME_BYTES, NOISE, SOCKET, wait_until
from report import expect

UNPLUGS = KILLS = 20
RECOVERY_S = 2.0


def read_noise(appliance, ms):
    """Feed the pictures of noise: which frames a reader got, as runs (times, index), and counts."""
    appliance.hold(NOISE[0])
    reader = appliance.machine.post(
        f"/share/vm_ring match {SOCKET} /share/frames.yuyv {FRAME_BYTES} 120 {NOISE[1] - 1}", 150)
    appliance.feed(NOISE, ms)
    code, out = appliance.machine.wait(reader)
    expect(code == 0, out.strip())
    counts = {name: int(value) for name, value in re.findall(r"^([a-z]+) (\d+)$", out, re.M)}
    runs = [(int(times), int(index)) for times, index in re.findall(r"^(\d+) (-?\d+)$", out, re.M)]
    # Before the first picture, while nothing is fed, vivid shows its own pattern.
    begin = max((i for i, run in enumerate(runs) if run[1] == -1 and
                 all(index in (-1, NOISE[0]) for _, index in runs[:i])), default=-1) + 1
    return runs[begin:], counts


def frames_arrive_bit_exact(appliance):
    """Noise shown frame by frame is what a reader gets, in order, none torn, none passed over."""
    appliance.load_camera()
    appliance.wait_for("Camera=streaming")
    # Longer on show than a camera under emulation takes from one frame to the next.
    for ms in (900, 2700) if appliance.slow else (100, 400):
        runs, counts = read_noise(appliance, ms)
        seen = [index for _, index in runs]
        expect(-1 not in seen, f"a frame equals none of those fed; the order was {seen}")
        expect(seen == sorted(set(seen)), f"not in order: {seen}")
        if len(seen) == NOISE[1]:
            break
    expect(seen == list(range(NOISE[1])), f"of {NOISE[1]} pictures came {seen}")
    expect(counts["backwards"] == 0 and counts["overtaken"] == 0, f"{counts}")
    return (f"{NOISE[1]} pictures of noise, {sum(times for times, _ in runs)} frames, each byte for "
            f"byte, a picture every {ms} ms; driver's gaps {counts['gaps']}, dropped "
            f"{counts['dropped']}")


def recover(appliance, harm, times, seconds):
    """Do harm so often: seconds until a reader had frames again, and the states it was told."""
    code, out = appliance.run(f"/usr/lib/vmtest/recover.py {harm} {times} {seconds} {SOCKET}",
                              times * (seconds + 5) + 60)
    took = [float(text) for text in re.findall(r"^back (.*)$", out, re.M)]
    states = re.search(r"^states(.*)$", out, re.M)
    expect(code == 0 and states and len(took) == times,
           f"{harm} {len(took) + 1} of {times}: {out.strip()[-300:]}")
    return took, states[1].split()


def camera_comes_back(appliance):
    """Unbind and bind the camera's driver; the daemon streams again within two seconds."""
    appliance.stop_feed()
    took, states = recover(appliance, "unplug", UNPLUGS, 20)
    appliance.set_camera()
    expect(max(took) <= RECOVERY_S, "it took " + " ".join(f"{seconds:.2f}" for seconds in took))
    unplugged = states.count("unplugged")
    expect(unplugged == UNPLUGS, f"unplugged {UNPLUGS} times, a reader was told {unplugged} times")
    return f"{UNPLUGS} times, back after {sorted(took)[UNPLUGS // 2]:.2f} s, worst {max(took):.2f} s"


def viewer_survives_killed_capture(appliance):
    """Kill the capture daemon; it comes back, its readers find it, and the viewer never went."""
    viewer = appliance.main_pid("diorama-viewd")
    before = appliance.restarts("diorama-captured")
    appliance.wait_for("State=view", 120)
    appliance.turn_by_hand()  # rendering would take the processor from the daemon that starts
    took, states = recover(appliance, "kill", KILLS, 20)
    restarts = appliance.restarts("diorama-captured") - before
    expect(restarts == KILLS, f"{restarts} restarts for {KILLS} kills")
    absent = states.count("absent")
    expect(absent >= KILLS, f"a reader saw it go {absent} times")
    expect(appliance.main_pid("diorama-viewd") == viewer, "the viewer was started anew")
    now = appliance.view()["State"]
    expect(now == "view", f"the viewer went from view to {now}")
    return f"{KILLS} times, frames again after {max(took):.1f} s at worst; the viewer stays in {now}"


def libcamera_captures(appliance):
    """The daemon with libcamera's driver, on vimc's pipeline."""
    appliance.must("modprobe vimc && udevadm settle")
    appliance.restart("diorama-captured", {"camera/source": "libcamera:0"})
    try:
        appliance.wait_for("Camera=streaming", 60)
        expect(wait_until(lambda: appliance.capture()["Frames"] >= 10, 60),
               f"no ten frames: {appliance.log_of('diorama-captured', 3)}")
        capture = appliance.capture()
        expect("vimc" in capture["Camera"].lower() or "sensor" in capture["Camera"].lower(),
               f"the camera is {capture['Camera']}")
        return (f"{capture['Frames']} frames of {capture['Width']}x{capture['Height']} "
                f"{capture['Format']} from {capture['Camera']}")
    finally:
        appliance.restart("diorama-captured")
        appliance.run("modprobe -r vimc")


def device_tests_pass(appliance):
    """The tests of the tree that want real lines, keyboards and displays."""
    appliance.must("systemctl stop diorama-viewd.service; modprobe -a uinput vkms; udevadm settle")
    results = []
    try:
        for name in ("gpio", "keyboard", "kms"):
            code, out = appliance.run(f"cd /tmp && DIO_DEVICE_TESTS=1 /share/device_{name}", 200)
            passed = re.search(r"\[  PASSED  \] (\d+) test", out)
            expect(code == 0 and passed, f"{name}: {code} {out.strip()[-400:]}")
            results.append(f"{name} {passed[1]}")
    finally:
        appliance.run("modprobe -r vkms; systemctl start diorama-viewd.service")
    return ", ".join(results)
