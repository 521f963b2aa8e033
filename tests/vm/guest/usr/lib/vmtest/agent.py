"""Run shell commands that come over a virtio port, one JSON object a line; answer in kind.

{"id": n, "run": "text", "timeout": s}  ->  {"id": n, "code": exit status, "out": both outputs}
Commands run side by side; one that takes too long is killed and its code is null.
"""
import json
import os
import signal
import subprocess
import threading
import time

PORT = '/dev/virtio-ports/org.diorama.vmtest'


def open_port():
    while True:
        try:
            return os.open(PORT, os.O_RDWR)
        except OSError:
            time.sleep(0.1)


def serve(port, lock, request):
    child = subprocess.Popen(['/bin/bash', '-c', request['run']], stdin=subprocess.DEVNULL,
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             start_new_session=True)
    try:
        out, _ = child.communicate(timeout=request['timeout'])
        code = child.returncode
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        out, _ = child.communicate()
        code = None
    answer = {'id': request['id'], 'code': code, 'out': out.decode(errors='replace')}
    data = json.dumps(answer).encode() + b'\n'
    with lock:
        while data:
            data = data[os.write(port, data):]


def main():
    port = open_port()
    lock = threading.Lock()
    text = b''
    while True:
        read = os.read(port, 65536)
        if not read:
            # Nobody is at the other end.
            time.sleep(0.1)
            continue
        text += read
        while b'\n' in text:
            line, text = text.split(b'\n', 1)
            threading.Thread(target=serve, args=(port, lock, json.loads(line))).start()


main()
