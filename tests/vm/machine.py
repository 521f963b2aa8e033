"""A virtual machine: QEMU, its monitor, and the agent inside that runs shell commands."""
import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path

MEMORY_MIB = 1536
DATA_MIB = 192
WORD_S = 10  # a word to the monitor
PROBE_S = 10  # KVM's kernel speaks within a second or two


class MachineError(Exception):
    pass


def kvm_works(image):
    """Whether the kernel comes up under KVM: /dev/kvm may be there and of no use."""
    if not os.access("/dev/kvm", os.R_OK | os.W_OK):
        return False
    probe = subprocess.Popen(["qemu-system-x86_64", "-machine", "q35", "-accel", "kvm", "-cpu",
                              "host", "-m", "512", "-nodefaults", "-display", "none", "-serial",
                              "stdio", "-kernel", f"{image}/kernel", "-initrd",
                              f"{image}/initrd.cpio", "-append", "console=ttyS0"],
                             stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                             stderr=subprocess.DEVNULL)
    timer = threading.Timer(PROBE_S, probe.kill)
    timer.start()
    found = any(b"Linux version" in line for line in probe.stdout)
    timer.cancel()
    probe.kill()
    probe.wait()
    return found


class Monitor:
    """QEMU's monitor protocol on a socket."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(WORD_S)
        self.socket.connect(str(path))
        self.file = self.socket.makefile("rw")
        self.file.readline()
        self.say("qmp_capabilities")

    def say(self, word, **arguments):
        self.file.write(json.dumps({"execute": word, "arguments": arguments}) + "\n")
        self.file.flush()
        while True:
            line = self.file.readline()
            if not line:
                raise MachineError(f"QEMU went away at '{word}'")
            answer = json.loads(line)
            if "error" in answer:
                raise MachineError(f"QEMU refuses '{word}': {answer['error']['desc']}")
            if "return" in answer:
                return answer["return"]


class Machine:
    """One machine on the image in `image`; what it leaves is in `folder`.

    The disk for the daemons' state is written through a log of every write and flush, so that the
    disk of any moment can be made of it afterwards.
    """

    def __init__(self, image, folder, share, accelerator):
        self.image, self.folder, self.share = Path(image), Path(folder), Path(share)
        self.accelerator = accelerator
        self.process = self.monitor = self.agent = None
        self.answers, self.next_id = {}, 0
        self.arrived = threading.Condition()
        self.data, self.log = self.folder / "data.img", self.folder / "writes.log"

    def make_data_disk(self):
        """An empty file system that belongs to the daemons' user."""
        owner, group = (self.image / "owner").read_text().split()
        with open(self.data, "wb") as file:
            file.truncate(DATA_MIB << 20)
        subprocess.run(["mkfs.ext4", "-q", "-F", "-E", f"root_owner={owner}:{group}",
                        str(self.data)], check=True)
        shutil.copyfile(self.data, self.folder / "data-first.img")
        self.log.write_bytes(b"")

    def command(self):
        cpu = "host" if self.accelerator == "kvm" else "max"
        accel = "kvm" if self.accelerator == "kvm" else "tcg,thread=multi"
        # An emulated processor without one of the host's of its own would only stand in the way.
        processors = min(2, len(os.sched_getaffinity(0)))
        return ["qemu-system-x86_64", "-machine", "q35", "-accel", accel, "-cpu", cpu,
                "-smp", str(processors), "-m", str(MEMORY_MIB), "-nodefaults",
                "-display", "none", "-no-user-config",
                "-serial", f"file:{self.folder}/console.log",
                "-kernel", str(self.image / "kernel"), "-initrd", str(self.image / "initrd.cpio"),
                # A process has its own memory alone, not what the kernel rounds up to 2 MiB.
                "-append", "console=ttyS0 quiet panic=-1 mitigations=off systemd.show_status=0 "
                "transparent_hugepage=never",
                "-drive", f"file={self.image}/root.img,format=raw,if=none,id=root,snapshot=on",
                "-device", "virtio-blk-pci,drive=root",
                "-blockdev", f"driver=file,filename={self.data},node-name=data-file",
                "-blockdev", f"driver=file,filename={self.log},node-name=log-file",
                "-blockdev", "driver=blklogwrites,node-name=data,log-sector-size=512,"
                "file.driver=raw,file.file=data-file,log.driver=raw,log.file=log-file",
                "-device", "virtio-blk-pci,drive=data,write-cache=on",
                "-virtfs", f"local,path={self.share},mount_tag=share,security_model=none",
                "-device", "bochs-display", "-device", "virtio-rng-pci",
                "-device", "virtio-serial-pci",
                "-chardev", f"socket,id=agent,path={self.folder}/agent.sock,server=on,wait=off",
                "-device", "virtserialport,chardev=agent,name=org.diorama.vmtest",
                "-device", "i6300esb", "-action", "watchdog=reset",
                "-qmp", f"unix:{self.folder}/monitor.sock,server=on,wait=off"]

    def start(self):
        for name in ("agent.sock", "monitor.sock"):
            (self.folder / name).unlink(missing_ok=True)
        self.errors = open(self.folder / "qemu.log", "wb")
        self.process = subprocess.Popen(self.command(), stdin=subprocess.DEVNULL,
                                        stdout=self.errors, stderr=self.errors,
                                        start_new_session=True)
        deadline = time.monotonic() + 30
        while not ((self.folder / "monitor.sock").exists() and
                   (self.folder / "agent.sock").exists()):
            if self.process.poll() is not None or time.monotonic() > deadline:
                said = (self.folder / "qemu.log").read_text(errors="replace").strip()
                raise MachineError(f"QEMU does not start: {said or 'it says nothing'}")
            time.sleep(0.05)
        self.monitor = Monitor(self.folder / "monitor.sock")
        self.agent = socket.socket(socket.AF_UNIX)
        self.agent.connect(str(self.folder / "agent.sock"))
        threading.Thread(target=self._listen, args=(self.agent,), daemon=True).start()

    def _listen(self, agent):
        try:
            for line in agent.makefile("rb"):
                self._take(line)
        except OSError:
            pass  # QEMU has ended

    def _take(self, line):
        try:
            answer = json.loads(line)
        except ValueError:
            return  # cut off by a reset
        with self.arrived:
            self.answers[answer["id"]] = answer
            self.arrived.notify_all()

    def post(self, command, timeout=60):
        """Have a command run; returns what wait() takes."""
        self.next_id += 1
        request = {"id": self.next_id, "run": command, "timeout": timeout}
        self.agent.sendall(json.dumps(request).encode() + b"\n")
        return self.next_id, timeout + WORD_S

    def wait(self, posted):
        """(exit status or None, output) of a command. Counted in waits of a second, not by the
        clock: a machine that was stopped meanwhile, as laptops are, is asked again first."""
        number, seconds = posted
        with self.arrived:
            for _ in range(int(seconds)):
                if number in self.answers or self.process.poll() is not None:
                    break
                self.arrived.wait(1)
            answer = self.answers.pop(number, None)
        if answer is None:
            return None, "the machine does not answer"
        return answer["code"], answer["out"]

    def run(self, command, timeout=60):
        return self.wait(self.post(command, timeout))

    def must(self, command, timeout=60):
        """Output of a command that has to go well."""
        code, out = self.run(command, timeout)
        if code != 0:
            raise MachineError(f"'{command}' ended with {code}: {out.strip()[-600:]}")
        return out

    def wait_boot(self, timeout):
        """Wait for the agent. A reset may swallow a call, so it is repeated; any answer counts."""
        calls = []
        for second in range(timeout):
            if second % 10 == 0:
                calls.append(self.post("true")[0])
            if self.process.poll() is not None:
                break
            with self.arrived:
                self.arrived.wait(1)
                if any(number in self.answers for number in calls):
                    return
        raise MachineError(f"the machine does not boot in {timeout} s; see "
                           f"{self.folder}/console.log")

    def reset(self):
        """Cut the power: what the guest has not written to its disk is lost."""
        self.monitor.say("system_reset")

    def screenshot(self, path):
        self.monitor.say("screendump", filename=str(path), format="png")

    def stop(self):
        if self.process and self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
