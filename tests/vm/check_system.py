"""Units, log, read-only root, watchdog, growth, packages."""
import re

from appliance import SOCKET, wait_until
from report import expect

UNITS = ("diorama-captured", "diorama-viewd")
EXPOSURE_MAX = 2.0


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
