"""Units, log, read-only root, watchdog, growth, packages."""
import re
import time

from appliance import SOCKET, WALK, wait_until
from report import expect

UNITS = ("diorama-captured", "diorama-viewd")
EXPOSURE_MAX = 2.0
GROWTH_MAX_KIB = 1024
WARM_PICTURES, WARM_S, REST_S = 3, 60, 12


def comes_up_on_a_read_only_root(appliance):
    code, out = appliance.run("systemctl is-system-running --wait", 120)
    failed = appliance.run("systemctl --failed --plain --no-legend")[1].strip()
    expect(not failed, f"failed units: {failed}")
    expect(code == 0 and out.strip() == "running", f"the system is {out.strip()}")
    mount = appliance.must("findmnt -no OPTIONS /").strip()
    expect(mount.split(",")[0] == "ro", f"the root is mounted {mount}")
    for unit in UNITS:
        expect(appliance.run(f"systemctl is-active {unit}.service")[0] == 0,
               f"{unit}: {appliance.log_of(unit, 3)}")
    took = appliance.must("systemd-analyze time").strip().splitlines()[0]
    return took.replace("Startup finished in ", "")


def units_are_locked_down(appliance):
    levels = []
    for unit in UNITS:
        out = appliance.must(f"systemd-analyze security --no-pager {unit}.service | tail -n 1")
        level = re.search(r": (\d+\.\d+)", out)
        expect(level, out.strip())
        levels.append(f"{unit} {level[1]}")
        expect(float(level[1]) <= EXPOSURE_MAX, levels[-1])
    return ", ".join(levels)


def without_late_threads(lines):
    """Without the traces of vivid's own threads that woke up late, as all does when emulated: they
    then wait for a negative time, which the kernel reports and takes for none."""
    kept, inside = [], False
    for line in lines:
        inside = inside or "schedule_timeout: wrong timeout value" in line
        if not inside:
            kept.append(line)
        inside = inside and "</TASK>" not in line
    return kept


def log_is_clean(appliance):
    """No failed unit, nothing of ours in the kernel's warnings, no warning of systemd's on us."""
    failed = appliance.run("systemctl --failed --plain --no-legend")[1].strip()
    expect(not failed, f"failed units: {failed}")
    kernel = appliance.must("journalctl -k -b -p warning -o cat --no-pager").splitlines()
    ours = [line for line in without_late_threads(kernel) if re.search(
        r"diorama|camera|engine|WARNING|BUG|Oops|segfault|vivid|bochs|drm|gpio|vdb", line)]
    ours = [line for line in ours if not re.search(r"vivid.*(injecting|out-of-tree)|taint", line)]
    expect(not ours, f"{len(ours)} lines: {ours[0] if ours else ''}")
    return f"{len(kernel)} warnings of the kernel, none of them ours"


def hang_viewer(appliance):
    """Stop the viewer as a hang would; whom to look for afterwards."""
    pid = appliance.main_pid("diorama-viewd")
    appliance.must(f"kill -STOP {pid}")
    return pid, appliance.now()


def watchdog_restarts_a_hung_viewer(appliance, hung):
    """The unit's own watchdog ends it and starts it again; nobody else does."""
    pid, since = hung
    expect(wait_until(lambda: appliance.restarts("diorama-viewd") > 0, 60),
           "it hangs and is not started anew")
    appliance.wait_for("State=idle", 60)
    expect(appliance.main_pid("diorama-viewd") != pid, "it is the same process")
    said = appliance.run("journalctl -u diorama-viewd -o short-monotonic --no-pager | "
                         "grep 'Watchdog timeout'")[1]
    at = re.search(r"^\[ *([\d.]+)\]", said)
    expect(at, "systemd says nothing of the watchdog")
    return f"ended {float(at[1]) - since:.0f} s after it hung, started anew, idle as before"


def measure(appliance):
    """{unit: (process, memory of its own in KiB, descriptors, threads)}"""
    found = {}
    for unit in UNITS:
        words = appliance.must(
            f"read pid < /sys/fs/cgroup/system.slice/{unit}.service/cgroup.procs; echo $pid; "
            "while read -r name value rest; do case $name in RssAnon:|Threads:) echo $value;; esac; "
            "done < /proc/$pid/status; set -- /proc/$pid/fd/*; echo $#").split()
        pid, memory, threads, descriptors = map(int, words)
        found[unit] = (pid, memory, descriptors, threads)
    return found


def picture(appliance):
    """What tells a rendered picture from the one before it."""
    view = appliance.view()
    return view["LatencyMs"], view["RenderMs"]


def stands_still(appliance):
    """All that is allocated once is allocated. What grows for ever never comes to this."""
    before = measure(appliance)
    time.sleep(REST_S)
    now = measure(appliance)
    return all(now[unit][1] - before[unit][1] < GROWTH_MAX_KIB / 4 for unit in UNITS)


def nothing_grows(appliance, seconds):
    """Memory, descriptors and threads over a run that tracks and renders."""
    appliance.feed(WALK, 700, 0)
    appliance.must("diorama ctl follow")
    appliance.wait_for("Source=tracked", 60)
    warm, shown = set(), set()
    expect(wait_until(lambda: len(warm.add(picture(appliance)) or warm) > WARM_PICTURES, 90),
           f"{len(warm)} pictures of a tracked viewpoint in 90 s")
    wait_until(lambda: stands_still(appliance), WARM_S)
    samples, end = [], time.monotonic() + seconds
    first = appliance.capture()["Frames"]
    while time.monotonic() < end:
        samples.append(measure(appliance))
        shown.add(picture(appliance))
        time.sleep(max(1, seconds / 60))
    frames = appliance.capture()["Frames"] - first
    expect(frames > seconds and len(shown) > max(2, seconds / 20),
           f"{frames} frames came, {len(shown)} pictures were seen in {seconds} s")
    third = max(1, len(samples) // 3)
    said = []
    for unit in UNITS:
        pids, memory, descriptors, threads = zip(*(sample[unit] for sample in samples))
        expect(len(set(pids)) == 1, f"{unit} was started anew")
        growth = sorted(memory[-third:])[third // 2] - sorted(memory[:third])[third // 2]
        expect(growth <= GROWTH_MAX_KIB, f"{unit}: {growth} KiB more: {memory}")
        for counts, what in ((descriptors, "descriptors"), (threads, "threads")):
            expect(max(counts[-third:]) <= max(counts[:third]), f"{unit}: {what}: {counts}")
        said.append(f"{unit} {memory[-1] // 1024} MiB ({growth:+d} KiB), {descriptors[-1]} "
                    f"descriptors, {threads[-1]} threads")
    return f"{seconds:.0f} s, {frames} frames, {len(shown)} pictures seen: " + "; ".join(said)


def comes_back_after_a_reset(appliance, boot_s):
    """The power goes while a scene is being made; the box comes up and shows it."""
    appliance.wait_for("State=view", 120)
    before = appliance.view()
    appliance.must("diorama ctl reconstruct && diorama ctl --timeout 20 wait State=reconstruct")
    appliance.machine.reset()
    appliance.machine.wait_boot(boot_s)
    comes_up_on_a_read_only_root(appliance)
    appliance.wait_for("State=view", 120)
    view = appliance.view()
    expect(view["Views"] == before["Views"] and view["Calibrated"],
           f"{view['Views']} views of {before['Views']}, calibrated: {view['Calibrated']}")
    return f"{view['Views']} views and their scene"


LEFT = ("/usr/libexec/diorama /usr/bin/diorama /usr/share/diorama /etc/diorama "
        "/lib/systemd/system/diorama-*.service /etc/systemd/system/multi-user.target.wants/diorama* "
        "/usr/lib/udev/rules.d/70-diorama.rules /usr/share/dbus-1/system.d/org.diorama* "
        "/usr/share/polkit-1/actions/org.diorama* /usr/lib/sysusers.d/diorama.conf "
        "/usr/lib/tmpfiles.d/diorama.conf /run/diorama /var/lib/systemd/deb-systemd-helper-*/diorama*")


def packages_purge_and_install(appliance):
    """Purge them from the running system, look for what is left, install them again."""
    appliance.use_profile({})
    appliance.must("mount -o remount,rw /")
    out = appliance.must("dpkg --purge diorama-appliance diorama 2>&1", 180)
    expect("warning" not in out.lower(), out.strip())
    left = appliance.run(f"ls -d {LEFT} 2>/dev/null; ls -A /var/lib/diorama | grep -v lost+found")[1]
    expect(not left.strip(), f"left behind: {left.split()}")
    expect(not appliance.run("pgrep -a diorama")[1].strip(), "daemons still run")
    failed = appliance.run("systemctl --failed --plain --no-legend")[1].strip()
    expect(not failed, f"failed units: {failed}")
    appliance.must("dpkg -i /packages/diorama_*.deb /packages/diorama-appliance_*.deb 2>&1", 240)
    for unit in UNITS:
        expect(wait_until(lambda: appliance.run(f"systemctl is-active {unit}")[0] == 0, 60),
               f"{unit} does not run: {appliance.log_of(unit, 3)}")
    expect(appliance.run(f"test -S {SOCKET}")[0] == 0, "no frame socket")
    return "nothing left; installed again, both daemons run"
