#!/usr/bin/env python3
"""run_docs.py PROGRAM PAGE...: runs every command of the pages (docs/writing.md says how pages mark them) and checks what
they write and print; of README.md checks that the program takes its commands. Ends with status 1 where one fails."""

import glob
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
COMMAND = re.compile(r"\s*(?:\$ )?interflect (solve|view|render|serve|formfactors|devices|check|bench|tune)\b")
DIRECTIVE = re.compile(r"<!-- (not run|needs|file|same as|status|until stopped)(?:: *(.*?))? *-->$")
FENCE = re.compile(r"```(\w*)$")
WRITES = ("-o", "--output", "--report", "--lightmap-image", "--form-factors", "--csv", "--plot", "--summary")
LIMIT = 300  # seconds for one command


class Wrong(Exception):
    """A page that does not hold what it promises."""


class Block:
    def __init__(self, line, language, directives):
        self.line, self.language, self.directives, self.text = line, language, directives, []


def blocks(text, name):
    """The fenced blocks of a page, and what is wrong with the rest of it."""
    found, wrong, directives, block = [], [], {}, None
    for number, line in enumerate(text.split("\n"), 1):
        fence, directive = FENCE.match(line), DIRECTIVE.match(line)
        if block is not None:
            if line == "```":
                found.append(block)
                block = None
            else:
                block.text.append(line)
        elif fence:
            block, directives = Block(number, fence.group(1), directives), {}
        elif directive:
            directives[directive.group(1)] = directive.group(2) or ""
        elif line.strip():
            if directives:
                wrong.append(f"{name}:{number}: a directive stands before no block")
                directives = {}
            if line.startswith("    ") and COMMAND.match(line):
                wrong.append(f"{name}:{number}: a command in a block that is not run: {line.strip()}")
    if block is not None:
        wrong.append(f"{name}:{block.line}: the block does not end")
    for block in found:
        if block.directives.get("not run") == "":
            wrong.append(f"{name}:{block.line}: 'not run' without a reason")
        if block.language not in ("sh", "output") and "not run" not in block.directives and any(map(COMMAND.match, block.text)):
            wrong.append(f"{name}:{block.line}: a command in a block that is not run")
    return found, wrong


def commands(lines):
    """The commands of a block: a line each, or several that end in a backslash or within quotes."""
    whole = ""
    for line in lines:
        if line.endswith("\\"):
            whole += line[:-1] + " "
            continue
        try:
            some = shlex.split(whole + line, comments=True)
        except ValueError:  # a quote that does not end here
            whole += line + "\n"
            continue
        if some:
            yield whole + line
        whole = ""
    if whole:
        raise Wrong(f"a command that does not end: {whole}")


def missing(program, where):
    """Whether a block's program is not there, which is said; an error where INTERFLECT_TEST_REQUIRE names it."""
    if program is None or shutil.which(program):
        return False
    if program in os.environ.get("INTERFLECT_TEST_REQUIRE", "").split(","):
        raise Wrong(f"{where}: {program} is required and not there")
    print(f"{where}: skipped, {program} is not there")
    return True


def promised(command):
    """The files that a command must write, by its options."""
    words = shlex.split(command, comments=True)
    if words[0] == "ffmpeg":
        return words[-1:]
    if words[0] != "interflect":
        return []
    # {name} stands for several files, and a rerun leaves them as they are: such a page lists them.
    names = [after for word, after in zip(words, words[1:]) if word in WRITES and "{" not in after]
    if words[1] == "bench" and "--json" in words:
        names.append(words[words.index("--json") + 1])
    return [name % 0 if "%" in name else name for name in names]


def agree(expected, printed, where):
    """Every expected line is printed, in this order; '...' stands for anything."""
    lines = iter(printed.split("\n"))
    for line in expected:
        if line.strip() in ("", "..."):
            continue
        pattern = re.compile(".*".join(re.escape(part).replace(r"\ ", " ") for part in line.rstrip().split("...")) + r"\s*$")
        if not any(pattern.match(one) for one in lines):
            raise Wrong(f"{where}: not printed (or not in this order): {line}\nbut:\n{printed}")


class Runner:
    def __init__(self, program, folder):
        self.folder = folder
        # No drivers: pages promise nothing of a GPU. Nothing that the user has kept is read or written.
        self.environment = dict(os.environ, OCL_ICD_VENDORS="/nonexistent", VK_ICD_FILENAMES="/nonexistent",
                                VK_DRIVER_FILES="/nonexistent", CUDA_VISIBLE_DEVICES="",
                                OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                                OMPI_MCA_rmaps_base_oversubscribe="1", OMPI_MCA_hwloc_base_binding_policy="none",
                                XDG_CACHE_HOME=os.path.join(folder, ".cache"),
                                PATH=os.path.dirname(os.path.abspath(program)) + os.pathsep + os.environ.get("PATH", ""))

    def run(self, command, status, where):
        """Runs one command to its end: what it printed."""
        start = time.time() - 1
        result = subprocess.run(["bash", "-c", command], cwd=self.folder, env=self.environment, timeout=LIMIT,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if result.returncode != status:
            raise Wrong(f"{where}: status {result.returncode} instead of {status}: {command}\n{result.stdout}")
        for name in promised(command) if status == 0 else []:
            path = os.path.join(self.folder, name)
            if not os.path.isfile(path) or os.path.getsize(path) == 0:
                raise Wrong(f"{where}: {name} was not written by: {command}")
            if not name.endswith(".iff") and os.path.getmtime(path) < start:
                raise Wrong(f"{where}: {name} is older than: {command}")
        return result.stdout

    def serve(self, command, where):
        """Starts a server, takes its page, and ends it by Ctrl-C."""
        words = shlex.split(command, comments=True)
        port = words[words.index("--port") + 1] if "--port" in words else None
        # The user's port may be taken here: any that is free, and the option itself is tried by its value.
        words = words[:words.index("--port")] + words[words.index("--port") + 2:] if port else words
        with tempfile.TemporaryFile("w+") as output:
            server = subprocess.Popen(words + ["--port", "0"], cwd=self.folder, env=self.environment, stdout=output,
                                      stderr=subprocess.STDOUT)
            try:
                for _ in range(10 * LIMIT):
                    output.seek(0)
                    printed = output.read()
                    address = re.search(r"http://[0-9.:]+/", printed)
                    if address or server.poll() is not None:
                        break
                    time.sleep(0.1)
                if not address:
                    raise Wrong(f"{where}: no address is printed by: {command}\n{printed}")
                with urllib.request.urlopen(address.group(0), timeout=60) as page:
                    if b"<html" not in page.read(4096):
                        raise Wrong(f"{where}: no page is served by: {command}")
                server.send_signal(signal.SIGINT)
                if server.wait(60) != 0:
                    raise Wrong(f"{where}: Ctrl-C ends with status {server.returncode}: {command}")
            finally:
                if server.poll() is None:
                    server.kill()
                server.wait()
            return printed


def run_page(program, path):
    """All blocks of a page, in order, in a fresh folder with the scenes. Returns how many commands ran."""
    name = os.path.basename(path)
    with open(path, encoding="utf-8") as file:
        found, wrong = blocks(file.read(), name)
    if wrong:
        raise Wrong("\n".join(wrong))
    count = 0
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(os.path.join(ROOT, "scenes"), os.path.join(folder, "scenes"))
        runner, printed = Runner(program, folder), None
        for block in found:
            where = f"{name}:{block.line}"
            if "file" in block.directives:
                with open(os.path.join(folder, block.directives["file"]), "w", encoding="utf-8") as file:
                    file.write("\n".join(block.text) + "\n")
            elif "same as" in block.directives:
                with open(os.path.join(ROOT, block.directives["same as"]), encoding="utf-8") as file:
                    if file.read().strip() != "\n".join(block.text).strip():
                        raise Wrong(f"{where}: not the same as {block.directives['same as']}")
            elif block.language == "output":
                if printed is None:
                    raise Wrong(f"{where}: output of no command")
                agree(block.text, printed, where)
            elif block.language == "sh":
                printed = None
                if "not run" in block.directives or missing(block.directives.get("needs"), where):
                    continue
                printed = ""
                for command in commands(block.text):
                    if "until stopped" in block.directives:
                        printed += runner.serve(command, where)
                    else:
                        printed += runner.run(command, int(block.directives.get("status", "0")), where)
                    count += 1
    return count


def taken(program, path):
    """The commands of a README, in a folder without their scenes: each ends soon, and not with the status of a wrong
    usage. Returns how many there are."""
    with open(path, encoding="utf-8") as file:
        text = file.read()
    lines = [line for line in text.split("\n") if line.startswith("    ") and COMMAND.match(line)]
    lines += [span for span in re.findall(r"`([^`]+)`", re.sub(r"\s*\n\s*", " ", text))
              if COMMAND.match(span) and "-" in span and "[" not in span and "|" not in span]
    count = 0
    for line in lines:
        words = [word for word in shlex.split(line, comments=True) if word != "..."]
        if words[1] == "check" and "--max-size" not in words:
            words += ["--max-size", "1"]
        if words[1] == "bench":
            words += [] if "--scenes" in words or "--from" in words else ["--scenes", "nowhere"]
        with tempfile.TemporaryDirectory() as folder:
            result = subprocess.run(words, cwd=folder, env=Runner(program, folder).environment, timeout=LIMIT,
                                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        scenes_asked_for = "is not found in nowhere" in result.stdout  # by a bench that has taken its options
        if result.returncode == 1 or (result.returncode == 2 and not scenes_asked_for):
            raise Wrong(f"{os.path.basename(path)}: status {result.returncode}: {line.strip()}\n{result.stdout}")
        count += 1
    return count


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    failed = 0
    for path in sys.argv[2:]:
        start = time.time()
        check = taken if os.path.basename(path) == "README.md" else run_page
        for page in sorted(glob.glob(os.path.join(path, "**", "*.md"), recursive=True)) if os.path.isdir(path) else [path]:
            try:
                print(f"{page}: {check(sys.argv[1], page)} commands, {time.time() - start:.1f} s", flush=True)
            except (Wrong, OSError, ValueError, subprocess.TimeoutExpired) as error:
                print(f"FAILED {page}\n{error}", flush=True)
                failed = 1
    sys.exit(failed)


if __name__ == "__main__":
    main()
