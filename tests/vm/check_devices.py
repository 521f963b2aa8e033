"""Camera, lines and display under real drivers."""
import re

from appliance import DROPS, FRAME_BYTES, NOISE, SOCKET, wait_until
from report import Failure, expect

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


# Faults that vivid injects as controls of its capture node; what the daemon says then, or counts;
# and what sets the camera right again.
FAULTS = (
    (f"{DROPS}=0,inject_v4l2_buf_flag_error=1", "Broken", ""),
    ("inject_fatal_streaming_error=1", "Recoveries", ""),
    ("inject_vidioc_qbuf_error=1", "Recoveries", ""),
    ("inject_vidioc_streamon_error=1,inject_fatal_streaming_error=1", "Recoveries", ""),
    ("inject_vidioc_reqbufs_error=1,inject_fatal_streaming_error=1", "Recoveries", ""),
    ("dv_timings_signal_mode=1", "no signal", "dv_timings_signal_mode=0"),
    ("dv_timings_signal_mode=2", "no signal", "dv_timings_signal_mode=0"),
    (f"{DROPS}=100", "stalled", f"{DROPS}=0"),
)
FAULT_S = 20
TRIES = 5  # vivid forgets a fault whose frame it has no buffer for


def survive(appliance, fault, effect, remedy):
    """One fault: what was to be seen of it is seen, and then frames come again."""
    before = appliance.capture()

    def is_seen():
        now = appliance.capture()
        return now[effect] > before[effect] if effect in now else now["State"] == effect

    for _ in range(TRIES):
        appliance.must(f"v4l2-ctl -d /dev/diorama/camera --set-ctrl={fault}")
        if wait_until(is_seen, FAULT_S / TRIES):
            break
    else:
        raise Failure(f"{fault}: nothing is seen of it: {appliance.capture()}")
    if remedy:
        appliance.must(f"v4l2-ctl -d /dev/diorama/camera --set-ctrl={remedy}")
    since = appliance.capture()["Frames"]
    expect(wait_until(lambda: appliance.capture()["Frames"] > since + 3, FAULT_S),
           f"{fault}: no frames any more: {appliance.capture()['StateText']}")


def faults_are_survived(appliance):
    """Errors that the driver injects while the daemon streams."""
    appliance.wait_for("Camera=streaming")
    pid = appliance.main_pid("diorama-captured")
    for fault in FAULTS:
        survive(appliance, *fault)
    expect(appliance.main_pid("diorama-captured") == pid, "the daemon was started anew")
    appliance.set_camera()
    return f"{len(FAULTS)} faults: " + ", ".join(fault for fault, _, _ in FAULTS)


SIZES = ((0, 0), (1, 1), (2, 2), (16, 16), (639, 479), (641, 481), (2560, 1920), (4096, 4096),
         (65535, 3), (3, 65535), (4294967295, 4294967295))
RATES = ("0.001", "1", "1000", "1e300", "inf", "nan", "-1")
OPENINGS = 30


def list_formats(appliance):
    """The camera's formats as numbers."""
    names = re.findall(r"'(.{4})(-BE)?'", appliance.must(
        "v4l2-ctl -d /dev/diorama/camera --list-formats"))
    return [int.from_bytes(name.encode(), "little") | (1 << 31 if big else 0)
            for name, big in names]


def ask_camera(appliance, lines):
    """What vm_camera answers to each line."""
    text = "\\n".join(lines)
    code, out = appliance.run(
        f"printf '{text}\\n' | /share/vm_camera v4l2:/dev/diorama/camera", 240)
    answers = out.splitlines()
    expect(code == 0 and len(answers) == len(lines),
           f"'{lines[min(len(answers), len(lines) - 1)]}' ends with {code}: {out[-300:].strip()}")
    for line, answer in zip(lines, answers):
        expect(re.match(r"ok |status \d+: .*camera", answer), f"'{line}': {answer}")
    return answers


def abuse_at_the_edges(appliance):
    """Sizes, rates and formats at their edges: each opens and streams, or is refused in a line."""
    appliance.must("systemctl stop diorama-captured.service; "
                   f"v4l2-ctl -d /dev/diorama/camera --set-ctrl={DROPS}=0,loop_video=0")
    try:
        edges = ask_camera(appliance, [f"{width} {height} 0 1" for width, height in SIZES] +
                           [f"640 480 {rate} 1" for rate in RATES])
        streamed = sum(answer.startswith("ok") for answer in edges)
        expect(streamed > 0, "no size streams")
        formats = list_formats(appliance)
        expect(len(formats) >= 50, f"vivid offers only {len(formats)} formats")
        # Whatever another program left in force, and often in a row.
        for answer in ask_camera(appliance, [f"640 480 0 1 {fourcc}" for fourcc in formats] +
                                 ["640 480 60 2"] * OPENINGS):
            expect(answer.startswith("ok"), answer)
        # Another process has the buffers, one or as many as the driver gives.
        for count in (1, 2, 32):
            code, out = appliance.run(
                f"v4l2-ctl -d /dev/diorama/camera --stream-mmap={count} --stream-count=1000 "
                "> /dev/null 2>&1 & other=$!; sleep 1; echo 0 0 0 1 | "
                "/share/vm_camera v4l2:/dev/diorama/camera; kill $other; wait", 30)
            expect("in use by another process" in out, f"{count} buffers elsewhere: {out.strip()}")
    finally:
        appliance.set_camera()
    return (f"{len(edges)} sizes and rates ({streamed} stream, {len(edges) - streamed} are refused "
            f"in a line), {len(formats)} formats found in force, {OPENINGS} openings, taken buffers")


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
