"""The appliance in the machine: its devices made by drivers of the kernel's, and its daemons."""
import json
import time

from report import Failure

WIDTH, HEIGHT = 640, 480
FRAME_BYTES = WIDTH * HEIGHT * 2
SOCKET = "/run/diorama/frames"
# Frames in share/frames.yuyv.
NOISE, DANCE, WALK = (0, 12), (12, 36), (48, 40)
FRAME_COUNT = 88
BUTTONS = {"calibrate": 0, "capture": 1, "view": 2}
LEDS = {"state": 3, "error": 4}
DROPS = "percentage_of_dropped_buffers"  # vivid passes over so many frames
CHIP = "/sys/kernel/config/gpio-sim/box"


class Appliance:
    def __init__(self, machine):
        self.machine = machine
        self.slow = machine.accelerator == "tcg"
        self.lines = None

    def run(self, command, timeout=60):
        return self.machine.run(command, timeout)

    def must(self, command, timeout=60):
        return self.machine.must(command, timeout)

    # The camera: an HDMI capture of vivid that shows what its HDMI output is given.

    def load_camera(self):
        self.must("modprobe vivid n_devs=1 node_types=0x101 num_inputs=1 input_types=0x3 "
                  "num_outputs=1 output_types=0x1 && udevadm settle")
        self.set_camera()

    def set_camera(self):
        """640x480, looped, with nobody streaming. Few frames a second where all is emulated."""
        camera, output = "/dev/diorama/camera", "/dev/vmtest/output"
        timings = f"--set-dv-bt-timings=cvt,width={WIDTH},height={HEIGHT},fps=40"
        size = f"width={WIDTH},height={HEIGHT},pixelformat=YUYV"
        self.stop_feed()
        self.must("systemctl stop diorama-captured.service; "
                  f"v4l2-ctl -d {output} {timings} --set-fmt-video-out={size} && "
                  f"v4l2-ctl -d {camera} {timings} --set-fmt-video={size} "
                  f"--set-ctrl=loop_video=1,osd_text_mode=2,{DROPS}={80 if self.slow else 0}; code=$?; "
                  "systemctl start diorama-captured.service; exit $code")

    def feed(self, frames, ms, rounds=1):
        """Show frames on the camera's input; the last one stays."""
        first, count = frames
        self.stop_feed()
        self.must("systemd-run --quiet --collect --unit=vmtest-feed /share/vm_feed "
                  f"/dev/vmtest/output /share/frames.yuyv {ms} {first} {count} {rounds}")

    def hold(self, frame):
        self.feed((frame, 1), 100, 0)

    def stop_feed(self):
        self.run("systemctl stop vmtest-feed.service 2>/dev/null")

    def set_watchdogs(self, patient):
        """Patient ones where all is emulated: the machine stands still while its host is busy."""
        for unit in ("diorama-captured", "diorama-viewd"):
            folder = f"/run/systemd/system/{unit}.service.d"
            self.must(f"mkdir -p {folder}; printf '[Service]\\nWatchdogSec=10min\\n' > "
                      f"{folder}/vmtest.conf" if patient else f"rm -rf {folder}")
        self.must("systemctl daemon-reload; systemctl restart diorama-captured.service "
                  "diorama-viewd.service")

    # Buttons and LEDs: lines of gpio-sim.

    def load_lines(self):
        names = [f"diorama-{name}" for name in BUTTONS] + [f"diorama-led-{name}" for name in LEDS]
        words = ["modprobe gpio-simulator", "mountpoint -q /sys/kernel/config || "
                 "mount -t configfs none /sys/kernel/config", f"mkdir -p {CHIP}/bank0",
                 f"echo {len(names)} > {CHIP}/bank0/num_lines"]
        for i, name in enumerate(names):
            words += [f"mkdir {CHIP}/bank0/line{i}", f"echo {name} > {CHIP}/bank0/line{i}/name"]
        # Buttons pull their lines down; a hand off them leaves them up before anybody looks.
        words += [f"echo 1 > {CHIP}/live", "udevadm settle"]
        self.must(" && ".join(words))
        device = self.must(f"cat {CHIP}/dev_name").strip()
        chip = self.must(f"cat {CHIP}/bank0/chip_name").strip()
        self.lines = f"/sys/devices/platform/{device}/{chip}"
        for line in BUTTONS.values():
            self.must(f"echo pull-up > {self.lines}/sim_gpio{line}/pull")

    def press(self, button, condition, ms=60, timeout=30, tries=3):
        """Press a button until a property says what should come of it. A hand may have to press
        again: a machine that stands still meanwhile makes a long press of a short one."""
        pull = f"{self.lines}/sim_gpio{BUTTONS[button]}/pull"
        for i in range(tries):
            self.must(f"/usr/lib/vmtest/press.py {pull} {ms}")
            code, out = self.run(f"diorama ctl --timeout {timeout} wait {condition}", timeout + 15)
            if code == 0:
                return
        view = self.view()
        raise Failure(f"{button} pressed {tries} times for {ms} ms: {condition} does not come; it "
                      f"is {view['State']}: {view['Message']}")

    def read_led(self, led, seconds=3):
        """Share of the time that an LED is lit, and how often it changes a second."""
        line = f"{self.lines}/sim_gpio{LEDS[led]}/value"
        samples = self.must("/usr/lib/vmtest/sample.py " + f"{line} {seconds}").strip()
        changes = sum(a != b for a, b in zip(samples, samples[1:]))
        return samples.count("1") / len(samples), changes / seconds

    # The daemons.

    def properties(self, name):
        """What a daemon says of itself on the bus."""
        out = self.must(f"busctl --json=short call {name} /{name.replace('.', '/')} "
                        f"org.freedesktop.DBus.Properties GetAll s {name}")
        return {key: value["data"] for key, value in json.loads(out)["data"][0].items()}

    def capture(self):
        return self.properties("org.diorama.Capture1")

    def view(self):
        return self.properties("org.diorama.View1")

    def wait_for(self, condition, timeout=60):
        code, out = self.run(f"diorama ctl --timeout {timeout} wait {condition}", timeout + 15)
        if code != 0:
            raise Failure(f"{out.strip().splitlines()[-1] if out.strip() else condition}")

    def turn_by_hand(self):
        """Show one viewpoint, rendered once, until somebody asks for another."""
        self.must("diorama ctl turn 0.3 0.2 0")
        self.wait_for("Source=hand", 60)

    def use_profile(self, changes):
        """Have the daemons read a changed profile: {"section/key": value}; {} for the own one."""
        self.run("while mountpoint -q /etc/diorama/board.ini; do umount /etc/diorama/board.ini; "
                 "done")
        if changes:
            script = "; ".join(
                f"/^\\[{name.split('/')[0]}\\]/,/^\\[/s#^{name.split('/')[1]} = .*"
                f"#{name.split('/')[1]} = {value}#" for name, value in changes.items())
            self.must(f"sed '{script}' /etc/diorama/board.ini > /run/board.ini && "
                      "mount --bind /run/board.ini /etc/diorama/board.ini")

    def restart(self, unit, changes=None):
        self.use_profile(changes or {})
        self.must(f"systemctl restart {unit}.service")

    def log_of(self, unit, lines=20):
        return self.run(f"journalctl -u {unit} -o cat --no-pager -n {lines}")[1]

    def main_pid(self, unit):
        return int(self.must(f"systemctl show -P MainPID {unit}.service"))

    def restarts(self, unit):
        return int(self.must(f"systemctl show -P NRestarts {unit}.service"))

    def now(self):
        """The machine's monotonic clock, seconds."""
        return float(self.must("cut -d' ' -f1 /proc/uptime"))


def wait_until(condition, timeout, pause=0.3):
    """Whether a condition comes true in time."""
    deadline = time.monotonic() + timeout
    while True:
        if condition():
            return True
        if time.monotonic() > deadline:
            return False
        time.sleep(pause)
