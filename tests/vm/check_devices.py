"""Camera, lines and display under real drivers."""
import re
import time

from appliance import FRAME_BYTES, NOISE, SOCKET, wait_until
from report import expect

UNPLUGS = KILLS = 20
RECOVERY_S = 2.0


def frames_arrive_bit_exact(appliance):
    """Noise shown frame by frame is what a reader gets, in order, none torn, none passed over."""
    appliance.load_camera()
    appliance.wait_for("Camera=streaming")
    # Longer on show than a camera under emulation takes from one frame to the next.
    ms = 400 if appliance.slow else 100
    count = NOISE[1]
    appliance.hold(NOISE[0])
    reader = appliance.machine.post(
        f"/share/vm_ring match {SOCKET} /share/frames.yuyv {FRAME_BYTES} {count * ms / 1000 + 6}",
        90)
    time.sleep(2)
    appliance.feed(NOISE, ms)
    code, out = appliance.machine.wait(reader)
    expect(code == 0, out.strip())
    counters = {name: int(value) for name, value in re.findall(r"^([a-z]+) (\d+)$", out, re.M)}
    runs = [(int(times), int(index)) for times, index in re.findall(r"^(\d+) (-?\d+)$", out, re.M)]
    # Before and after, while nothing is fed, vivid shows its own pattern.
    fed = [index for _, index in runs if index >= 0]
    frames = sum(times for times, index in runs if index >= 0)
    while len(fed) > count and fed[0] == NOISE[0]:
        fed.pop(0)
    expect(fed == list(range(NOISE[0], count)), f"of {count} frames in order came {fed}")
    inside = [index for _, index in runs]
    last = len(inside) - 1 - inside[::-1].index(NOISE[0] + count - 1)
    first = last - count + 1
    expect(inside[first:last + 1] == list(range(NOISE[0], count)),
           f"frames between those fed equal none of them: {inside}")
    expect(counters["backwards"] == 0 and counters["overtaken"] == 0,
           f"backwards {counters['backwards']}, overtaken {counters['overtaken']}")
    return (f"{count} pictures of noise, {frames} frames, each byte for byte; driver's gaps "
            f"{counters['gaps']}, dropped {counters['dropped']}")


def camera_comes_back(appliance):
    """Unbind and bind the camera's driver; the daemon streams again within two seconds."""
    appliance.stop_feed()
    driver = "/sys/bus/platform/drivers/vivid"
    watcher = appliance.machine.post(f"timeout {UNPLUGS * 6} /share/vm_ring watch {SOCKET} 300 > "
                                     "/tmp/watch", UNPLUGS * 6 + 20)
    time.sleep(1)
    out = appliance.must(
        f"for i in $(seq {UNPLUGS}); do echo vivid.0 > {driver}/unbind; sleep 0.3; "
        f"echo vivid.0 > {driver}/bind; cut -d' ' -f1 /proc/uptime; sleep 2.2; done; "
        "pkill -x vm_ring", UNPLUGS * 10)
    appliance.machine.wait(watcher)
    plugged = [float(line) for line in out.split()]
    expect(len(plugged) == UNPLUGS, f"the driver was bound {len(plugged)} times of {UNPLUGS}")
    watched = [line.split() for line in appliance.must("cat /tmp/watch").splitlines()]
    frames = [float(words[0]) for words in watched if words[1] == "frame"]
    took = []
    for at in plugged:
        after = [frame - at for frame in frames if frame >= at - 0.02]
        expect(after, f"no frame after the camera was plugged in at {at}")
        took.append(max(after[0], None))
    expect(max(took) <= RECOVERY_S, f"it took up to {max(took):.2f} s: "
           + " ".join(f"{s:.2f}" for s in took))
    unplugged = sum(words[1:3] == ["state", "unplugged"] for words in watched)
    expect(unplugged == UNPLUGS, f"readers were told of {unplugged} of {UNPLUGS}")
    return f"{UNPLUGS} times, back after {sorted(took)[len(took) // 2]:.2f} s, worst {max(took):.2f} s"


def viewer_survives_killed_capture(appliance):
    """Kill the capture daemon; it comes back, and the viewer never went."""
    viewer = appliance.main_pid("diorama-viewd")
    before = appliance.restarts("diorama-captured")
    state = appliance.status()[1]["State"]
    out = appliance.must(
        f"for i in $(seq {KILLS}); do pid=$(systemctl show -P MainPID diorama-captured.service); "
        "start=$(cut -d' ' -f1 /proc/uptime); kill -KILL $pid; "
        "diorama ctl --timeout 5 wait Camera=absent > /dev/null 2>&1; "
        "diorama ctl --timeout 20 wait Camera=streaming || exit 1; "
        "echo $start $(cut -d' ' -f1 /proc/uptime); done", KILLS * 25)
    times = [line.split() for line in out.splitlines()]
    took = [float(end) - float(start) for start, end in times]
    expect(len(took) == KILLS, f"back {len(took)} times of {KILLS}")
    expect(appliance.restarts("diorama-captured") - before == KILLS,
           f"{appliance.restarts('diorama-captured') - before} restarts for {KILLS} kills")
    expect(appliance.main_pid("diorama-viewd") == viewer, "the viewer was started anew")
    now = appliance.status()[1]["State"]
    expect(now == state, f"the viewer went from {state} to {now}")
    return f"{KILLS} times, viewer sees frames again after {max(took):.1f} s at worst; it stays in {now}"


def libcamera_captures(appliance):
    """The daemon with libcamera's driver, on vimc's pipeline."""
    appliance.must("modprobe vimc && udevadm settle")
    appliance.restart("diorama-captured", {"camera/source": "libcamera:0"})
    try:
        appliance.wait_for("Camera=streaming", 60)
        expect(wait_until(lambda: appliance.status()[0]["Frames"] >= 10, 60),
               f"no ten frames: {appliance.log_of('diorama-captured', 3)}")
        capture = appliance.status()[0]
        expect("vimc" in capture["Camera"].lower() or "sensor" in capture["Camera"].lower(),
               f"the camera is {capture['Camera']}")
        return (f"{capture['Frames']} frames of {capture['Width']}x{capture['Height']} "
                f"{capture['Format']} from {capture['Camera']}")
    finally:
        appliance.restart("diorama-captured")
        appliance.run("modprobe -r vimc")


# Faults that vivid injects, as controls of its capture node, and what sets them right again.
FAULTS = (("inject_v4l2_buf_flag_error=1", None), ("inject_vidioc_streamon_error=1", None),
          ("inject_vidioc_reqbufs_error=1", None),
          ("dv_timings_signal_mode=1", "dv_timings_signal_mode=0"),
          ("dv_timings_signal_mode=2", "dv_timings_signal_mode=0"))


def list_controls(appliance):
    out = appliance.must("v4l2-ctl -d /dev/diorama/camera --list-ctrls")
    return re.findall(r"^\s*(\w+) 0x", out, re.M)


def abuse_at_the_edges(appliance):
    """Sizes, rates and formats at their edges: each opens and streams, or is refused in a line."""
    appliance.must("systemctl stop diorama-captured.service")
    sizes = [(0, None), (1, 1), (2, 2), (16, 16), (639, 479), (641, 481), (3840, 2160), (4096, 4096),
             (16384, 16384), (65535, 3), (4294967295, 4294967295)]
    streamed = refused = 0
    try:
        for width, height in sizes:
            for fps in ("0", "0.001", "1000"):
                code, out = appliance.run("/share/vm_camera v4l2:/dev/diorama/camera "
                                          f"{width} {height} {fps} 1 1", 30)
                expect(code == 0 and re.match(r"(ok|status \d+: .*camera)", out),
                       f"{width}x{height} at {fps}: {code} {out.strip()}")
                streamed += out.startswith("ok")
                refused += not out.startswith("ok")
        expect(streamed > 0, "no size streamed")
        formats = re.findall(r"'(....)'", appliance.must(
            "v4l2-ctl -d /dev/diorama/camera --list-formats"))
        for name in formats:
            appliance.run(f"v4l2-ctl -d /dev/diorama/camera --set-fmt-video=pixelformat='{name}'")
            code, out = appliance.run(
                "/share/vm_camera v4l2:/dev/diorama/camera 0 0 0 1 1", 30)
            expect(code == 0 and out.startswith("ok"), f"left in {name}: {code} {out.strip()}")
        # Another process has the buffers, one or as many as the driver gives.
        for count in (1, 2, 32):
            code, out = appliance.run(
                f"v4l2-ctl -d /dev/diorama/camera --stream-mmap={count} --stream-count=1000 "
                "> /dev/null 2>&1 & other=$!; sleep 1.5; "
                "/share/vm_camera v4l2:/dev/diorama/camera 0 0 0 1 1; kill $other; wait", 30)
            expect("in use by another process" in out, f"{count} buffers elsewhere: {out.strip()}")
        code, out = appliance.run("/share/vm_camera v4l2:/dev/diorama/camera 640 480 60 2 30", 120)
        expect(code == 0 and out.count("ok") == 30, f"opened 30 times in a row: {out.strip()[-200:]}")
    finally:
        appliance.set_camera()
    return (f"{len(sizes) * 3} sizes and rates ({streamed} stream, {refused} are refused in a line), "
            f"{len(formats)} formats found in force, taken buffers, 30 openings")


def faults_are_survived(appliance):
    """Errors that the driver injects while the daemon streams."""
    known = list_controls(appliance)
    done = []
    appliance.wait_for("Camera=streaming")
    pid = appliance.main_pid("diorama-captured")
    for fault, remedy in FAULTS:
        if fault.split("=")[0] not in known:
            continue
        appliance.must(f"v4l2-ctl -d /dev/diorama/camera --set-ctrl={fault}; sleep 1.2")
        if remedy:
            appliance.must(f"v4l2-ctl -d /dev/diorama/camera --set-ctrl={remedy}")
        appliance.wait_for("Camera=streaming", 20)
        before = appliance.status()[0]["Frames"]
        expect(wait_until(lambda: appliance.status()[0]["Frames"] > before + 3, 20),
               f"{fault}: no frames any more")
        done.append(fault)
    expect(len(done) >= 4, f"vivid offers only {done}")
    expect(appliance.main_pid("diorama-captured") == pid, "the daemon was started anew")
    return ", ".join(done)


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
