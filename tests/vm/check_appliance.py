"""From the board to the picture on the screen, by buttons alone."""
import subprocess
from pathlib import Path

import cv2
import numpy as np

from appliance import DANCE, WALK, wait_until
from report import Failure, expect

PSNR_MIN_DB = 35.0
SPREAD_MIN = 5.0  # of a picture that is not empty, of 255
SAVED = "shown"


def buttons_and_lamps_work(appliance):
    """Presses reach the daemon, and each state has its pattern on the LED."""
    appliance.load_lines()
    # The viewer looks for lines that were not there a few times a second.
    pid = appliance.main_pid("diorama-viewd")
    expect(wait_until(lambda: "gpio" in appliance.must(f"ls -l /proc/{pid}/fd"), 30),
           "the daemon takes no line: " + appliance.log_of("diorama-viewd", 3))
    seen = []
    # Emulated on a busy machine, flashes of 50 ms may fall between two looks.
    expect_led(appliance, "idle", 0.0 if appliance.slow else 0.01, 0.3, seen)
    appliance.press("calibrate", "State=calibrate")
    expect_led(appliance, "calibrate", 0.2, 0.8, seen)
    appliance.must("diorama ctl cancel")
    # A button that asks for what cannot be lights the other one.
    appliance.press("view", "Alarm=true")
    lit, changes = appliance.read_led("error")
    expect(0.2 < lit < 0.8 and changes > 2, f"error: lit {lit:.2f}, {changes:.1f} changes a second")
    return ", ".join(seen) + f", error {lit:.2f} at {changes:.1f} changes/s"


def expect_led(appliance, state, least, most, seen):
    lit, changes = appliance.read_led("state")
    expect(least <= lit <= most, f"in {state} the LED is lit {lit:.2f} of the time, "
           f"not {least} to {most}")
    seen.append(f"{state} lit {lit:.2f}")


def feed_until(appliance, frames, done, what, rates):
    """Feed frames, slower each time, until it is done; a busy machine sees few of them."""
    for ms in rates:
        appliance.feed(frames, ms)
        if wait_until(done, frames[1] * ms / 1000 + 20):
            return ms
    raise Failure(f"{what}; {appliance.view()}")


def calibrates_from_the_button(appliance, shots):
    appliance.press("calibrate", "State=calibrate")

    def is_done():
        # What was shown may not cover the corners of the picture: a second press fits anyway.
        view = appliance.view()
        if view["State"] == "calibrate" and view["BoardViews"] >= 12 and view["Coverage"] > 0.45:
            appliance.machine.screenshot(shots / "calibrate.png")
            appliance.press("calibrate", "Calibrated=true", timeout=120, tries=1)
        return appliance.view()["Calibrated"]

    ms = feed_until(appliance, DANCE, is_done, "the camera is not calibrated",
                    (800, 1600) if appliance.slow else (150, 400, 800))
    appliance.wait_for("State=idle")
    view = appliance.view()
    return f"{view['Message']} ({view['BoardViews']} views, a picture every {ms} ms)"


def captures_and_reconstructs_from_the_button(appliance, shots):
    appliance.press("capture", "State=capture")
    feed_until(appliance, WALK, lambda: appliance.view()["Views"] >= 4,
               "not four views were kept", (900, 1800) if appliance.slow else (250, 600, 1200))
    appliance.stop_feed()  # before as many views are kept as start it by themselves
    appliance.machine.screenshot(shots / "capture.png")
    expect(appliance.view()["State"] == "capture", "it did not wait for the button")
    appliance.press("capture", "State=view", ms=1300, timeout=150)
    view = appliance.view()
    lit, _ = appliance.read_led("state")
    expect(lit == 1.0, f"in view the LED is lit {lit:.2f} of the time")
    return f"{view['Views']} views; {view['Message']}; state LED on"


def psnr(a, b):
    error = np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2)
    return 99.0 if error == 0 else 10 * np.log10(255 ** 2 / error)


def render_saved(saved, tools, patch_px):
    """What `diorama render` makes on the host of a saved scene and viewpoint, in bytes."""
    ran = subprocess.run([tools / "diorama", "render", "--scene-cache", saved / "scene.safetensors",
                          "--path", saved / "view.tum", "--out", saved / "render", "--raw",
                          "--deblock", "on", "--patch-render", str(patch_px),
                          "--precision", "fixed"],
                         capture_output=True, text=True)
    expect(ran.returncode == 0, f"diorama render: {ran.stderr.strip()}")
    rendered = np.load(saved / "render" / "frames.npy")[-1]
    return np.rint(np.clip(rendered, 0, 1) * 255).astype(np.uint8)


def compare_screen(machine, path, rendered):
    """(PSNR of the screen, spread of what it should show)"""
    machine.screenshot(path)
    screen = cv2.imread(str(path))[..., ::-1]
    height, width = screen.shape[:2]
    expect(width * rendered.shape[0] == height * rendered.shape[1],
           f"a {width}x{height} screen has bars beside the picture")
    wanted = cv2.resize(rendered, (width, height), interpolation=cv2.INTER_LINEAR)
    cv2.imwrite(str(path.with_name("rendered.png")), wanted[..., ::-1])
    return psnr(screen, wanted), float(np.std(wanted))


def shows_what_render_renders(appliance, shots, tools):
    """The screen against `diorama render` of the same scene, pose and patch on the host."""
    saved = Path(appliance.machine.share) / SAVED
    appliance.hold(WALK[0] + 20)
    appliance.restart("diorama-viewd", {"display/overlay": "no"})
    appliance.wait_for("State=view", 120)
    appliance.wait_for("Source=tracked", 60)
    # Then by hand: emulated, the camera is seen so seldom that its viewpoint comes and goes.
    appliance.turn_by_hand()
    view = appliance.view()
    folder = appliance.must(f"rm -rf /var/lib/diorama/scenes/{SAVED}; "
                            f"diorama ctl save {SAVED}").strip()
    appliance.must(f"rm -rf /share/{SAVED}; cp -r {folder} /share/{SAVED}")
    rendered = render_saved(saved, tools, view["PatchPx"])
    found = []
    # The picture of this viewpoint stays, but on its way to the screen it may still be.
    wait_until(lambda: found.append(compare_screen(appliance.machine, shots / "view.png",
                                                   rendered)) or found[-1][0] >= PSNR_MIN_DB,
               60 if appliance.slow else 5, 1)
    got, spread = found[-1]
    after = appliance.view()
    expect((after["Source"], after["PatchPx"]) == ("hand", view["PatchPx"]),
           f"shown from {after['Source']}, patch {after['PatchPx']}, not {view['PatchPx']}")
    expect(spread > SPREAD_MIN, f"the picture is empty: its spread is {spread:.1f}")
    expect(got >= PSNR_MIN_DB, f"{got:.1f} dB, less than {PSNR_MIN_DB}")
    return (f"{got:.1f} dB between the screen and diorama render (spread {spread:.0f}); rendering "
            f"takes {after['RenderMs']:.0f} ms here")
