#!/usr/bin/python3
"""recover.py unplug|kill TIMES SECONDS SOCKET: do harm to the camera or to its daemon so often.

After each waits until a reader of the ring has a frame again, SECONDS at most, and prints "back
SECONDS": from the kill, or from when the camera is there again, which it is when the reader has
been told that it is not. Then "states NAME ...": all that the reader was told."""
import os
import queue
import signal
import subprocess
import sys
import threading
import time

DRIVER = "/sys/bus/platform/drivers/vivid"
DAEMON = "/sys/fs/cgroup/system.slice/diorama-captured.service/cgroup.procs"
UNPLUGGED_S = 0.3


class Reader:
    def __init__(self, socket, seconds):
        self.process = subprocess.Popen(["/share/vm_ring", "watch", socket, "3600"],
                                        stdout=subprocess.PIPE, text=True)
        self.seconds = seconds
        self.said, self.states = queue.Queue(), []
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stdout:
            at, *words = line.split()
            if words[0] == "state":
                self.states.append(words[1])
            self.said.put((words[-1], float(at)))

    def wait_for(self, word):
        """When it was said; all before it is forgotten."""
        end = time.monotonic() + self.seconds
        try:
            while True:
                said, at = self.said.get(timeout=max(end - time.monotonic(), 0.01))
                if said == word:
                    return at
        except queue.Empty:
            sys.exit(f"'{word}' does not come in {self.seconds:.0f} s")

    def forget(self):
        while not self.said.empty():
            self.said.get()


def write(path, text):
    with open(path, "w") as file:
        file.write(text)


def unplug(reader):
    write(f"{DRIVER}/unbind", "vivid.0")
    reader.wait_for("unplugged")
    time.sleep(UNPLUGGED_S)
    write(f"{DRIVER}/bind", "vivid.0")
    return time.monotonic()


def kill(reader):
    at = time.monotonic()
    with open(DAEMON) as file:
        os.kill(int(file.readline()), signal.SIGKILL)
    reader.wait_for("absent")
    return at


def main():
    harm, times, seconds, socket = sys.argv[1:]
    reader = Reader(socket, float(seconds))
    try:
        reader.wait_for("frame")
        for _ in range(int(times)):
            reader.forget()
            at = {"unplug": unplug, "kill": kill}[harm](reader)
            # A frame from before may still come behind the news that the camera is gone.
            reader.wait_for("streaming")
            print(f"back {max(reader.wait_for('frame') - at, 0):.3f}", flush=True)
    finally:
        reader.process.kill()
        print("states", *reader.states)


main()
