"""`interflect serve` as its clients meet it: what it solves against independent solves, and clients that mean harm.

serve_test.py PROGRAM [TEST...], with nothing but Python's standard library."""

import http.client
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "browser"))
import room  # noqa: E402
from served import Served, read_solution  # noqa: E402

PROGRAM = None
NO_DRIVERS = {"OCL_ICD_VENDORS": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent", "VK_DRIVER_FILES": "/nonexistent"}
JSON = {"Content-Type": "application/json"}


def largest_difference(a, b):
    """Of two lists of radiosities, relative to the largest."""
    largest = max(max(row) for row in b)
    return max(abs(x - y) for p, q in zip(a, b) for x, y in zip(p, q)) / largest


class Server(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="interflect-serve-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.scene = room.write_scene(cls.folder.name, "room", list(room.LAMPS))
        cls.solver = room.Solver(PROGRAM, cls.folder.name)
        cls.served = Served(PROGRAM, cls.scene, environment=NO_DRIVERS)
        cls.addClassCleanup(cls.served.close)
        cls.port = cls.served.port

    def tearDown(self):
        self.assertIsNone(self.served.process.poll(), "the server has ended")
        self.assertEqual(self.ask("GET", "/scene")[0], 200)

    def ask(self, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    def post(self, path, body, **headers):
        text = body if isinstance(body, (str, bytes)) else json.dumps(body)
        return self.ask("POST", path, text, {**JSON, **headers})

    def solve(self, **change):
        status, _, body = self.post("/solve", change)
        self.assertEqual(status, 200, body[:200])
        return read_solution(body)

    def refused(self, answer, status, *words):
        """With one clear line."""
        self.assertEqual(answer[0], status, answer[2][:300])
        said = json.loads(answer[2])["error"]
        self.assertNotIn("\n", said)
        for word in words:
            self.assertIn(word, said)

    def raw(self, text):
        """The status of what is answered to these bytes; 0 where nothing is."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=60) as s:
            s.sendall(text)
            s.shutdown(socket.SHUT_WR)
            answer = b""
            while piece := s.recv(65536):
                answer += piece
        return int(answer.split()[1]) if answer else 0

    # ---- what it solves

    def independent(self, name, old="", new=""):
        """All lamps' radiosities by `solve`, of the scene with a line of its materials changed."""
        scene = room.write_scene(self.folder.name, name, list(room.LAMPS))
        materials = os.path.join(self.folder.name, name + ".mtl")
        with open(materials, encoding="utf-8") as file:
            text = file.read()
        self.assertIn(old, text)
        with open(materials, "w", encoding="utf-8") as file:
            file.write(text.replace(old, new))
        out = os.path.join(self.folder.name, name + ".npy")
        self.solver.solve(scene, "solve", "-o", out)
        with open(out, "rb") as file:
            data = file.read()
        start = 10 + struct.unpack("<H", data[8:10])[0]
        values = struct.unpack(f"<{(len(data) - start) // 4}f", data[start:])
        return [values[k:k + 3] for k in range(0, len(values), 3)]

    def test_the_light_is_that_of_the_changed_scene(self):
        for name, change, old, new in (
                ("same", {}, "", ""),
                ("left", {"reflectance": {"paint_left": [0.2, 0.7, 0.3]}}, "Kd 0.6 0.15 0.1", "Kd 0.2 0.7 0.3"),
                ("black", {"reflectance": {"paint_floor": [0, 0, 0]}}, "Kd 0.55 0.4 0.25", "Kd 0 0 0"),
                ("lamp", {"emittance": {"glow_0": [3, 30, 0]}}, "Ke 24.0 15.0 7.0", "Ke 3 30 0")):
            wanted = self.independent(name, old, new)
            said, lit = self.solve(tolerance=1e-6, **change)
            self.assertTrue(said["converged"])
            self.assertLessEqual(max(said["relative_residual"]), 1e-6)
            self.assertEqual(len(lit), 2)
            have = [tuple(map(sum, zip(*rows))) for rows in zip(*lit)]
            self.assertEqual(len(have), len(wanted))
            self.assertLess(largest_difference(have, wanted), 2e-5, name)
            if name == "left":  # the twin: a hundredth beside it
                _, beside = self.solve(tolerance=1e-6, reflectance={"paint_left": [0.2, 0.71, 0.3]})
                beside = [tuple(map(sum, zip(*rows))) for rows in zip(*beside)]
                self.assertGreater(largest_difference(beside, wanted), 2e-4)

    def test_each_lamp_is_a_part_of_its_own(self):
        _, lit = self.solve(tolerance=1e-6)
        for lamp, rows in zip(room.LAMPS, lit):
            alone = [row["b"] for row in self.solver.table([lamp])]
            self.assertLess(largest_difference(rows, alone), 2e-5)
        self.assertGreater(largest_difference(lit[0], lit[1]), 0.1)

    def test_a_small_change_costs_fewer_products(self):
        def far():  # so that what follows does not begin near its end
            return self.solve(tolerance=1e-6, reflectance={m["name"]: [0.05] * 3 for m in self.scene_json()["materials"]})
        def near(value):
            return self.solve(tolerance=1e-6, reflectance={"paint_floor": [value, 0.4, 0.25]})
        with Served(PROGRAM, self.scene, "--tol", "0.1", environment=NO_DRIVERS) as fresh:
            cold = None
            connection = http.client.HTTPConnection("127.0.0.1", fresh.port, timeout=60)
            connection.request("POST", "/solve", json.dumps({"tolerance": 1e-6}), JSON)
            cold, cold_lit = read_solution(connection.getresponse().read())
            connection.close()
        far()
        from_far, _ = near(0.55)
        near(0.545)
        warm, lit = near(0.55)
        self.assertTrue(warm["warm"] and warm["converged"] and cold["converged"])
        self.assertLess(warm["products"], cold["products"])
        self.assertLess(warm["products"], from_far["products"])
        for a, b in zip(lit, cold_lit):
            self.assertLess(largest_difference(a, b), 2e-5)

    def test_the_tolerance_counts(self):
        rough, _ = self.solve(tolerance=0.1, reflectance={"paint_back": [0.3, 0.3, 0.3]})
        fine, _ = self.solve(tolerance=1e-6, reflectance={"paint_back": [0.3, 0.3, 0.3]})
        self.assertLessEqual(max(fine["relative_residual"]), 1e-6)
        self.assertGreater(max(rough["relative_residual"]), 1e-6)

    def test_a_room_that_loses_nothing_ends(self):
        names = [m["name"] for m in self.scene_json()["materials"]]
        said, lit = self.solve(reflectance={name: [1, 1, 1] for name in names})
        self.assertTrue(said["converged"] or said["reason"])
        self.assertTrue(all(v == v for rows in lit for row in rows for v in row))

    def test_names_in_another_encoding(self):
        """Old OBJ files: what the page shows of such a name is what it asks by."""
        for suffix in ("obj", "mtl"):
            with open(os.path.join(self.folder.name, "room." + suffix), "rb") as file:
                text = file.read().replace(b"paint_left", b"w\xe4nde").replace(b"room.mtl", b"latin.mtl")
            with open(os.path.join(self.folder.name, "latin." + suffix), "wb") as file:
                file.write(text)
        with Served(PROGRAM, os.path.join(self.folder.name, "latin.obj"), environment=NO_DRIVERS) as latin:
            here, self.port = self.port, latin.port
            try:
                self.assertIn("w\ufffdnde", [m["name"] for m in self.scene_json()["materials"]])
                _, lit = self.solve(tolerance=1e-6, reflectance={"w\ufffdnde": [0.2, 0.7, 0.3]})
            finally:
                self.port = here
        _, wanted = self.solve(tolerance=1e-6, reflectance={"paint_left": [0.2, 0.7, 0.3]})
        _, before = self.solve(tolerance=1e-6)
        for a, b, c in zip(lit, wanted, before):
            self.assertLess(largest_difference(a, b), 2e-5)
            self.assertGreater(largest_difference(a, c), 1e-3)  # the twin

    def test_a_tolerance_that_was_asked_for_first_may_be_asked_for_again(self):
        with Served(PROGRAM, self.scene, "--tol", "1e-8", environment=NO_DRIVERS) as fine:
            here, self.port = self.port, fine.port
            try:
                self.assertEqual(self.scene_json()["tolerance"], 1e-8)
                self.assertEqual(self.solve(tolerance=1e-8)[0]["tolerance"], 1e-8)
                self.refused(self.post("/solve", {"tolerance": 0.9e-8}), 400, "tolerance")
            finally:
                self.port = here
        self.refused(self.post("/solve", {"tolerance": 1e-8}), 400, "tolerance", "1e-07")

    def scene_json(self):
        return json.loads(self.ask("GET", "/scene")[2])

    def test_what_can_change_is_listed(self):
        scene = self.scene_json()
        materials = {m["name"]: m for m in scene["materials"]}
        self.assertEqual(materials["paint_left"]["reflectance"], [0.6, 0.15, 0.1])
        self.assertIsNone(materials["paint_left"]["emittance"])
        self.assertEqual(materials["glow_1"]["emittance"], [6, 11, 22])
        self.assertEqual((scene["device"], scene["lamps"]), ("openmp", 2))

    # ---- devices

    def test_devices(self):
        listed = json.loads(self.ask("GET", "/devices")[2])
        self.assertEqual([d["id"] for d in listed if d["used"]], ["openmp"])
        self.refused(self.post("/device", {"device": "vulkan:77"}), 400)
        self.refused(self.post("/device", {"device": 7}), 400)
        self.refused(self.post("/device", {"device": "openmp", "more": 1}), 400)
        for device in listed:
            if not device["available"]:
                self.refused(self.post("/device", {"device": device["id"]}), 409, "openmp stays in use")
        status, _, body = self.post("/device", {"device": "openmp"})
        self.assertEqual((status, json.loads(body)["device"]), (200, "openmp"))
        self.assertTrue(self.solve()[0]["converged"])

    # ---- who may ask, and for what

    def test_the_page(self):
        status, headers, body = self.ask("GET", "/")
        self.assertEqual((status, headers["Content-Type"]), (200, "text/html; charset=utf-8"))
        self.assertIn(b"connect-src 'self'", body)
        self.assertEqual(headers["X-Frame-Options"], "DENY")
        status, headers, nothing = self.ask("HEAD", "/")
        self.assertEqual((status, nothing, int(headers["Content-Length"])), (200, b"", len(body)))

    def test_paths_and_methods(self):
        for path in ("/nothing", "/scene/", "//", "/index.html", "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd",
                     "/..%2f..%2fetc%2fpasswd", "/scene/../../etc/passwd", "/room.obj", "/./", "/%00", "/" + "a" * 5000):
            self.refused(self.ask("GET", path), 404)
        self.assertEqual(self.raw(b"GET http://127.0.0.1/etc/passwd HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"), 404)
        self.assertEqual(self.raw(b"GET ../../etc/passwd HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"), 404)
        for method, path, allowed in (("POST", "/", "GET, HEAD"), ("DELETE", "/scene", "GET, HEAD"), ("GET", "/solve", "POST"),
                                      ("PUT", "/solve", "POST"), ("OPTIONS", "/device", "POST")):
            answer = self.ask(method, path, headers=JSON)
            self.refused(answer, 405)
            self.assertEqual(answer[1]["Allow"], allowed)

    def test_other_origins_are_kept_out(self):
        for host in ("evil.example", "127.0.0.1.evil.example", "localhost.evil.example:80", "", "[::1", "127.0.0.1:80:80",
                     "8.8.8.8", "localhost@evil.example"):
            self.refused(self.ask("GET", "/", headers={"Host": host}), 403, "Host")
        for host in (f"localhost:{self.port}", "LOCALHOST", "127.0.0.1:9", "[::1]:80", "127.0.0.9"):
            self.assertEqual(self.ask("GET", "/", headers={"Host": host})[0], 200, host)
        own = f"http://127.0.0.1:{self.port}"
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{self.port}", "http://127.0.0.1:1",
                       f"http://localhost:{self.port}"):
            self.refused(self.post("/solve", {}, Origin=origin), 403, "Origin")
        self.assertEqual(self.post("/solve", {}, Origin=own)[0], 200)
        for site in ("cross-site", "same-site"):
            self.refused(self.post("/solve", {}, **{"Sec-Fetch-Site": site}), 403)
        self.assertEqual(self.post("/solve", {}, **{"Sec-Fetch-Site": "same-origin"})[0], 200)
        for kind in ("Application/JSON", "application/json ; charset=utf-8"):
            self.assertEqual(self.ask("POST", "/solve", "{}", {"Content-Type": kind})[0], 200, kind)
        for kind in ("text/plain", "application/x-www-form-urlencoded", "application/jsonp", ";application/json", ""):
            self.refused(self.ask("POST", "/solve", "{}", {"Content-Type": kind}), 415)

    def test_bodies(self):
        for body, *words in (
                ("", "not JSON"), ("{", "not JSON"), ("[]", "object"), ("nonsense", "not JSON"), (b"\xff\xfe{}", "not JSON"),
                ('{"reflectance": {"paint_left": [NaN, 0, 0]}}', "not JSON"),
                ('{"reflectance": {"paint_left": [1e999, 0, 0]}}', "not JSON"),
                ('{"reflectance": {"paint_left": [1.0001, 0, 0]}}', "paint_left", "from 0 to 1"),
                ('{"reflectance": {"paint_left": [0, -1e-9, 0]}}', "paint_left"),
                ('{"reflectance": {"paint_left": [0, null, 0]}}', "paint_left"),
                ('{"reflectance": {"paint_left": ["0.5", 0, 0]}}', "paint_left"),
                ('{"reflectance": {"paint_left": [0.5, 0.5]}}', "three"), ('{"reflectance": {"paint_left": 0.5}}', "three"),
                ('{"reflectance": [0.5]}', "reflectance"),
                ('{"reflectance": {"no such": [0, 0, 0]}}', "no such"),
                ('{"emittance": {"paint_left": [1, 1, 1]}}', "paint_left", "does not emit"),
                ('{"emittance": {"glow_0": [-1, 0, 0]}}', "glow_0"), ('{"emittance": {"glow_0": [1e10, 0, 0]}}', "glow_0"),
                ('{"tolerance": 0}', "tolerance"), ('{"tolerance": 1}', "tolerance"), ('{"tolerance": "1e-4"}', "tolerance"),
                ('{"reflectivity": {}}', "reflectivity"), ('{"tolerance": 1e-3, "tolerance": 1e-4}', "twice"),
                ('{"client": ' + json.dumps("x" * 65) + "}", "client"), ('{"client": 5}', "client"),
                ("[" * 30000, "deep"), ('{"reflectance":' * 2000, "deep"),
                ('{"reflectance": {"a\\nb\\u0000": [0, 0, 0]}}', "no material")):
            self.refused(self.post("/solve", body), 400, *words)
        self.refused(self.post("/solve", " " * 70000), 413)
        self.assertEqual(self.post("/solve", " " * 60000 + "{}")[0], 200)

    def test_what_is_no_http(self):
        for text in (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 20, b"nonsense\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n",
                     b"GET /\r\n\r\n", b"POST /solve HTTP/1.1\r\nHost: localhost\r\nContent-Length: -5\r\n\r\n"):
            self.assertEqual(self.raw(text), 400, text)
        head = b"POST /solve HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        self.assertEqual(self.raw(head + b"Content-Length: 99999999999\r\n\r\n"), 413)
        self.assertEqual(self.raw(head + b"Transfer-Encoding: chunked\r\n\r\n" + b"8000\r\n" + b" " * 0x8000 + b"\r\n8001\r\n"
                                  + b" " * 0x8001 + b"\r\n0\r\n\r\n"), 413)
        self.assertEqual(self.raw(head + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"), 200)
        self.assertEqual(self.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"A: " + b"x" * 20000 + b"\r\n\r\n"), 431)
        self.assertEqual(self.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"A: x\r\n" * 5000 + b"\r\n"), 431)
        self.assertEqual(self.raw(b""), 0)

    # ---- many at once

    def test_a_hundred_at_once(self):
        answers, start = [], threading.Barrier(100)

        def client(k):
            start.wait()
            try:
                answers.append(self.post("/solve", {"client": f"c{k % 50}", "reflectance": {"paint_left": [k / 100] * 3}}))
            except OSError as error:
                answers.append((str(error), {}, b""))

        threads = [threading.Thread(target=client, args=(k,)) for k in range(100)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        statuses = [answer[0] for answer in answers]
        self.assertEqual(len(statuses), 100)
        self.assertLessEqual(set(statuses), {200, 409, 503}, statuses)
        self.assertIn(200, statuses)
        for status, headers, body in answers:
            if status == 200:
                self.assertTrue(read_solution(body)[0]["converged"])
            if status == 503:
                self.assertEqual(headers["Retry-After"], "1")

    def test_the_newest_change_of_a_client_counts(self):
        """Edits that come faster than solves: the last is always solved, and those that were passed over say so."""
        answers = {}

        def client(k):
            answers[k] = self.post("/solve", {"client": "one", "tolerance": 1e-6, "reflectance": {"paint_right": [0.01 * k] * 3}})

        threads = [threading.Thread(target=client, args=(k,)) for k in range(12)]
        for thread in threads:
            thread.start()
            time.sleep(0.001)
        for thread in threads:
            thread.join()
        statuses = [answer[0] for answer in answers.values()]
        self.assertEqual(len(statuses), 12)
        self.assertLessEqual(set(statuses), {200, 409})
        self.assertIn(200, statuses)
        for answer in answers.values():
            if answer[0] == 409:
                self.refused(answer, 409, "newer")
        self.assertEqual(self.solve(client="one")[0]["converged"], True)

    def test_clients_that_hang(self):
        """Half a request, and a hundred of them; an answer that is not read. Others are served, now or soon."""
        hanging = []
        try:
            for k in range(100):
                s = socket.create_connection(("127.0.0.1", self.port), timeout=60)
                s.sendall(b"POST /solve HTTP/1.1\r\nHost: loc" if k % 2 else b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                hanging.append(s)
            while True:
                status, headers, _ = self.ask("GET", "/scene")
                if status == 200:
                    break
                self.assertEqual((status, headers["Retry-After"]), (503, "1"))
                time.sleep(0.1)
        finally:
            for s in hanging:
                s.close()


class Beginning(unittest.TestCase):
    """How it starts and ends."""

    def run_program(self, *arguments):
        return subprocess.run([PROGRAM, "serve", *arguments], capture_output=True, text=True, timeout=120,
                              env={**os.environ, **NO_DRIVERS})

    def test_a_port_that_is_taken(self):
        with tempfile.TemporaryDirectory() as folder, socket.create_server(("127.0.0.1", 0)) as taken:
            scene = room.write_scene(folder, "room", list(room.LAMPS))
            port = str(taken.getsockname()[1])
            done = self.run_program(scene, "--divide", "1", "--device", "openmp", "--quiet", "--port", port)
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        self.assertIn(f"cannot listen on 127.0.0.1:{port}: Address already in use", done.stderr)

    def test_wrong_options(self):
        scene = room.write_scene(self.enterContext(tempfile.TemporaryDirectory()), "room", list(room.LAMPS))
        for arguments, status in ((["x.obj", "--port", "70000"], 2), (["x.obj", "--tol", "nan"], 2), (["/nonexistent.obj"], 3),
                                  ([scene, "--divide", "1", "--quiet", "--host", ""], 2), ([], 2)):
            done = self.run_program(*arguments, "--device", "openmp")
            self.assertEqual(done.returncode, status, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)

    def test_it_ends_when_told(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = room.write_scene(folder, "room", list(room.LAMPS))
            for told in (signal.SIGINT, signal.SIGTERM):
                served = Served(PROGRAM, scene, environment=NO_DRIVERS)
                with socket.create_connection(("127.0.0.1", served.port), timeout=60) as idle:
                    idle.sendall(b"GET / HT")
                    served.process.send_signal(told)
                    self.assertEqual(served.process.wait(60), 0)
                served.close()

    def test_the_measurement(self):
        with tempfile.TemporaryDirectory() as folder:
            scene = room.write_scene(folder, "room", list(room.LAMPS))
            done = self.run_program(scene, "--divide", "0.5", "--device", "openmp", "--quiet", "--measure", "0.01")
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = done.stdout.splitlines()
        self.assertEqual(len(lines), 4, done.stdout)
        self.assertNotIn("NOT CONVERGED", done.stdout)
        self.assertTrue(all(line.split()[0] == "room" and float(line.split()[-1]) > 0 for line in lines[1:3]), done.stdout)


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    unittest.main()
