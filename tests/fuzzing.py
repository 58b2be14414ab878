"""Spoiled files for every reader: whatever comes, it is read or refused in one line.

Small valid files of every format (`fuzz_seeds`) are spoiled (`fuzz_mutations`) and read, and what was read is used a little. A
defect is anything but a sound result or an IntaglioError of one line that names the file: another exception, output, a foreign
warning, NaN in the result, an altered input, files left behind, a crash, more than 10 seconds or 1.5 GiB.

    python tests/fuzzing.py [--seconds 600] [--count N] [--seed 0] [--jobs 2]
    python tests/fuzzing.py repeat out/fuzz/0001-read_surface

Reading is done by processes of their own under limits. Each defect's files go to out/fuzz/ with a case.json that says what
happened.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import faulthandler
import io
import json
import os
import re
import resource
import secrets
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

SECONDS = 10
HANGS = 60
STARTS = 240
MEMORY = 3 << 29
LONGEST = 2500
KEPT_OF_A_KIND = 3


# What is done with a file: the reader, and a first use of what it gives. What is returned must be finite.


def targets() -> dict[str, Callable[[Path], object]]:
    """Return the readers by name."""
    import intaglio
    from intaglio import IntaglioError
    from intaglio.cli import masks
    from intaglio.files import read_exr_header, read_image_with_type, read_samples
    from intaglio.mesh import read_mesh_file, read_point_file
    from intaglio.photometric import examine_capture, read_light_positions
    from intaglio.synthesis import read_trials

    def used(function, *arguments, **options):
        """Do something with what was read, which may be too little for it."""
        with contextlib.suppress(IntaglioError):
            return function(*arguments, **options)

    def surface(path, **options):
        found = intaglio.read_surface(path, **options)
        # What Intaglio wrote comes back as it is, and the cut through a one-sided surface lies where its sides could be joined.
        own = b"property double base_x" in path.read_bytes() or any("one-sided" in note for note in found.notes)
        try:
            intaglio.mend_surface(found, strict=not own)
        except IntaglioError as error:
            raise AssertionError(f"a surface that was read needs mending: {error}") from error
        used(intaglio.list_holes, found)
        return dataclasses.replace(found, uv=None)

    def mesh(path):
        found = read_mesh_file(path)
        assert not len(found.faces) or (found.faces.min() >= 0 and found.faces.max() < len(found.vertices)), (
            "faces name no vertex"
        )
        used(found.joined_color)
        # Not a number is how a corner says that it has none, and vertices are mended later.
        return None

    def samples(path):
        # Floats are given as they are stored.
        found = read_samples(path)
        read_image_with_type(path)
        return found if found.dtype.kind != "f" else None

    def image(path):
        stored = read_samples(path)
        found = intaglio.read_image(path)
        assert found.shape == stored.shape, "shapes differ"
        return found if stored.dtype.kind != "f" else None

    def exr(path):
        read_exr_header(path)
        intaglio.read_exr(path)
        used(intaglio.read_exr, path, part=1)

    def mask(path):
        with contextlib.suppress(IntaglioError):
            masks.read_mask(path, (1, 1), path)
        shape = read_samples(path).shape[:2]
        return masks.read_mask(path, shape, path)

    def photographs(path):
        found = intaglio.read_photographs(path)
        for photograph in found:
            camera = photograph.camera
            assert np.allclose(camera.R @ camera.R.T, np.eye(3), atol=1e-3), "R is no rotation"
            used(camera.project, np.eye(3) + 5)
            used(photograph.read)
        return [(p.camera.K, p.camera.R, p.camera.t, p.camera.distortion) for p in found]

    def stack(path):
        found = intaglio.read_stack(path)
        assert np.allclose(np.linalg.norm(found.lights, axis=1), 1), "lights are not of length 1"
        assert (found.lights[:, 2] > 0).all(), "lights from below"
        shown = np.where(found.mask[..., None], found.image(0), 0) if found.mask is not None else found.image(0)
        used(examine_capture, path)
        return found.lights, shown

    def relightable(path):
        found = intaglio.read_relightable(path)
        images = found.relight([[0.0, 0, 1], [0.5, 0, 0.8], [0, -0.9, 0.1]])
        return images, found.maps, found.chroma

    def material(path):
        return dict(intaglio.read_material(path).maps)

    def ranks(path):
        _names, table = intaglio.read_ranks(path)
        found = used(intaglio.friedman, table)
        return table, found and (found.statistic, found.pvalue)

    def geometry(path):
        return intaglio.read_geometry_texture(path)

    def facts(path):
        from intaglio.cli.entry import cli

        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            cli.main(["info", "--quiet", str(path)], standalone_mode=False)
        lines = said.getvalue().splitlines()
        # Names in the file may be anything.
        given = b"".join(content_of(path if path.is_dir() else path.parent).values()).lower()
        bad = [] if b"nan" in given or b"inf" in given else [line for line in lines if re.search(r"\b(nan|inf)\b", line)]
        assert not bad, f"info says {bad[0][:300]}"

    return {
        "read_surface": surface,
        "read_surface_of_points": lambda path: surface(path, view=(0, 0, -1)),
        "read_mesh_file": mesh,
        "read_uv_mesh": lambda path: intaglio.geometry.read_uv_mesh(path)[:2],
        "read_point_file": read_point_file,
        "read_geometry_texture": geometry,
        "read_image": image,
        "read_samples": samples,
        "read_exr": exr,
        "read_mask": mask,
        "read_photographs": photographs,
        "read_stack": stack,
        "read_light_positions": lambda path: read_light_positions(path)[1],
        "read_relightable": relightable,
        "read_material": material,
        "read_ranks": ranks,
        "read_trials": lambda path: [t[0] for t in read_trials(path).values()],
        "info": facts,
    }


# Judging


def not_finite(value, where="result", depth=0) -> str | None:
    """Return where a result has numbers that are not finite; None if it has none."""
    if depth > 6 or value is None:
        return None
    if isinstance(value, float | np.floating):
        return None if np.isfinite(value) else where
    if isinstance(value, np.ndarray):
        return where if value.dtype.kind in "fc" and not np.isfinite(value).all() else None
    if dataclasses.is_dataclass(value):
        # Colours that are unknown, say, would be None.
        value = {f.name: getattr(value, f.name, None) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    else:
        return None
    return next((bad for key, inner in items if (bad := not_finite(inner, f"{where}.{key}", depth + 1))), None)


@dataclasses.dataclass
class Verdict:
    """What came of a file: "read", "refused" or a defect, which has a kind to tell it from others and a text."""

    outcome: str
    kind: str = ""
    text: str = ""


def content_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def judge(call: Callable[[Path], object], folder: Path, entry: str) -> Verdict:
    """Give a file of a folder to a reader, and judge what happens. Whoever calls has to look after crashes, time and memory."""
    from intaglio import IntaglioError, IntaglioWarning

    path = folder / entry if entry != "." else folder
    before = content_of(folder)
    temporary = set(os.listdir(tempfile.gettempdir()))
    error: BaseException | None = None
    result = None
    started = time.process_time()
    caught: list[warnings.WarningMessage] = []
    foreign: list[traceback.StackSummary | str] = []

    def show(message, category, filename, lineno, file=None, line=None):
        """Keep where a foreign warning came from."""
        caught.append(warnings.WarningMessage(message, category, filename, lineno))
        if not foreign and not issubclass(category, IntaglioWarning):
            foreign.extend(
                [
                    traceback.StackSummary.from_list(traceback.extract_stack()[:-1]),
                    f"{category.__name__}: {message} ({filename}:{lineno})",
                ]
            )

    with warnings.catch_warnings(), heard_streams() as heard:
        warnings.showwarning = show
        warnings.simplefilter("always")
        try:
            result = call(path)
        except Exception as problem:
            error = problem
    seconds = time.process_time() - started
    if isinstance(error, IntaglioError):
        said = str(error)
        names = {str(folder), path.name, *before, *(Path(name).name for name in before)}
        if "\n" in said or len(said) > LONGEST:
            return Verdict("defect", f"message: {type(error).__name__}", f"a message of {len(said)} characters: {said[:300]!r}")
        # What is very long is shortened in messages.
        if not any(name in said or name[:80] in said for name in names):
            return Verdict("defect", f"message without the file: {re.sub(r'[0-9.]+', '#', said)[:60]}", said[:500])
        verdict = Verdict("refused", text=said)
    elif error is not None:
        return Verdict(
            "defect",
            f"{type(error).__name__} at {origin(traceback.extract_tb(error.__traceback__))}",
            "".join(traceback.format_exception(error))[-3000:],
        )
    else:
        verdict = Verdict("read")
        bad = not_finite(result)
        if bad:
            return Verdict("defect", f"not finite: {re.sub('[0-9]+', '#', bad)}", f"{bad} is not finite")
    if foreign:
        return Verdict("defect", f"warning at {origin(foreign[0])}", "".join(foreign[0].format()) + str(foreign[1]))
    long = [str(w.message) for w in caught if "\n" in str(w.message) or len(str(w.message)) > LONGEST]
    if long:
        return Verdict("defect", "long warning", f"a warning of {len(long[0])} characters: {long[0][:300]!r}")
    if heard[0]:
        return Verdict("defect", f"output: {re.sub('[0-9]+', '#', heard[0])[:40]}", heard[0][:1000])
    if seconds > SECONDS:
        return Verdict("defect", "slow", f"took {seconds:.1f} seconds")
    if content_of(folder) != before:
        return Verdict("defect", "input changed", f"the folder holds other files: {sorted(content_of(folder))}")
    left = set(os.listdir(tempfile.gettempdir())) - temporary
    if left:
        return Verdict("defect", "files left", f"left in the temporary folder: {sorted(left)[:5]}")
    return verdict


def origin(frames: traceback.StackSummary) -> str:
    """Return the innermost line of the package in a stack."""
    own = [f for f in frames if "/toolkit/" in f.filename or "/intaglio/" in f.filename]
    own = own or [f for f in frames if Path(f.filename).name != "warnings.py"]
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}"


@contextlib.contextmanager
def heard_streams():
    """Give a list whose only entry is, after the block, what the process wrote to its output and errors."""
    heard: list[str] = []
    with tempfile.TemporaryFile() as instead:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        kept = [os.dup(1), os.dup(2)]
        os.dup2(instead.fileno(), 1)
        os.dup2(instead.fileno(), 2)
        try:
            yield heard
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            for number, copy in enumerate(kept, 1):
                os.dup2(copy, number)
                os.close(copy)
            instead.seek(0)
            heard.append(instead.read(20000).decode("utf-8", "replace"))


# Cases


def write_files(files: dict[str, bytes], folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


class Cases:
    """The cases of a seed, by number."""

    def __init__(self, seed: int) -> None:
        from fuzz_seeds import make_seeds

        from intaglio.files import READABLE_SUFFIXES
        from intaglio.mesh import POINT_FILES, WRITABLE

        self.seed = seed
        self.seeds = make_seeds()
        self.targets = targets()
        self.by_target = {name: [s for s in self.seeds if name in s.targets] for name in self.targets}
        self.others = [data for s in self.seeds for name, data in s.files.items() if name == s.entry or len(s.files) < 4]
        self.suffixes = sorted(
            {*READABLE_SUFFIXES, *POINT_FILES, *WRITABLE, ".ptm", ".lp", ".json", ".xml", ".sfm", ".out", ".nvm"}
        )
        # Readers of many formats get more.
        self.shares = np.array([3 + len(found) for found in self.by_target.values()], float)

    def make(self, number: int):
        """Return the target, the files, the entry and the name of the seed of a case."""
        from fuzz_mutations import pick, spoil_files

        rng = np.random.default_rng([self.seed, number])
        target = str(rng.choice(list(self.by_target), p=self.shares / self.shares.sum()))
        # Now and then another reader's file.
        choice = self.by_target[target] if rng.random() < 0.97 else self.seeds
        seed = pick(rng, choice)
        files, entry = spoil_files(seed, rng, self.others, self.suffixes)
        return target, files, entry, seed.name


def work(place: Path, seed: int) -> None:
    """Take numbers of cases from the input, judge them, and answer with a line of JSON each."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    faulthandler.enable(open(place / "crash.txt", "w"))  # noqa: SIM115
    cases = Cases(seed)
    folder = place / "case"
    # Once as they are: what is imported and compiled late counts for nobody.
    for one in cases.seeds:
        for target in one.targets:
            write_files(one.files, folder)
            verdict = judge(cases.targets[target], folder, one.entry)
            if verdict.outcome == "defect" and verdict.kind != "slow":
                answers.write(json.dumps({"seed": one.name, "target": target, "kind": verdict.kind, "text": verdict.text}) + "\n")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    answers.write('{"ready": true}\n')
    for line in sys.stdin:
        (place / "case.json").write_text(
            json.dumps({"target": "none yet", "entry": ".", "of": "", "seed": seed, "number": int(line)})
        )
        target, files, entry, seed_name = cases.make(int(line))
        write_files(files, folder)
        about = {"target": target, "entry": entry, "of": seed_name, "seed": seed, "number": int(line)}
        (place / "case.json").write_text(json.dumps(about))
        verdict = judge(cases.targets[target], folder, entry)
        if verdict.kind == "input changed":
            write_files(files, folder)
        answers.write(json.dumps({**about, **dataclasses.asdict(verdict)}) + "\n")


# Running


class Worker:
    """A process that judges cases, and is started again when one ends it."""

    def __init__(self, place: Path, seed: int) -> None:
        self.place, self.seed = place, seed
        self.process: subprocess.Popen | None = None
        self.faulty: list[dict] = []

    def start(self) -> None:
        (self.place / "tmp").mkdir(parents=True, exist_ok=True)
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "INTAGLIO_THREADS"), "1")
        words = [sys.executable, __file__, "work", str(self.place), str(self.seed)]
        self.process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **one, "TMPDIR": str(self.place / "tmp")},
        )
        while True:
            answer = self.answer(STARTS)
            if answer is None:
                self.stop()
                raise RuntimeError(f"a worker could not start; python tests/fuzzing.py work {self.place} {self.seed} says why")
            if "ready" in answer:
                return
            self.faulty.append(answer)

    def answer(self, seconds: float) -> dict | None:
        """Return the next answer; None if none comes in time or the process has ended."""
        assert self.process is not None
        ready, _, _ = select.select([self.process.stdout], [], [], seconds)
        line = self.process.stdout.readline() if ready else b""
        return json.loads(line) if line else None

    def judge(self, number: int) -> dict:
        if self.process is None:
            self.start()
        assert self.process is not None
        self.process.stdin.write(f"{number}\n".encode())
        self.process.stdin.flush()
        answer = self.answer(HANGS)
        if answer is not None:
            return answer
        try:
            ended = self.process.wait(5)
        except subprocess.TimeoutExpired:
            ended = None
        self.stop()
        about = json.loads((self.place / "case.json").read_text())
        crash = (self.place / "crash.txt").read_text()
        where = re.findall(r'File "([^"]*(?:toolkit|intaglio)/[^"]*)", line (\d+)', crash)
        kind = "hangs" if ended is None else f"crash {ended}"
        kind += f" at {Path(where[0][0]).name}:{where[0][1]}" if where else ""
        return {**about, "outcome": "defect", "kind": kind, "text": crash[:3000]}

    def stop(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


@dataclasses.dataclass
class Tally:
    """What came of all cases: number of outcomes by target, and the defects."""

    counts: collections.Counter = dataclasses.field(default_factory=collections.Counter)
    defects: dict[tuple[str, str], list[dict]] = dataclasses.field(default_factory=dict)
    faulty_seeds: list[dict] = dataclasses.field(default_factory=list)


def fuzz(seed: int, out: Path, *, count: int | None = None, seconds: float | None = None, jobs: int = 1) -> Tally:
    """Judge ``count`` cases, or as many as there is time for; each defect's files go to ``out``."""
    tally, lock = Tally(), threading.Lock()
    numbers = iter(range(10**9 if count is None else count))
    until = None

    def serve(place: Path) -> None:
        nonlocal until
        worker = Worker(place, seed)
        try:
            worker.start()
            with lock:
                until = until or time.monotonic() + (1e9 if seconds is None else seconds)
            while time.monotonic() < until:
                with lock:
                    number = next(numbers, None)
                if number is None:
                    break
                answer = worker.judge(number)
                with lock:
                    record(answer, place)
        finally:
            worker.stop()
            with lock:
                # All workers find the same.
                tally.faulty_seeds = tally.faulty_seeds or worker.faulty

    def record(answer: dict, place: Path) -> None:
        tally.counts[answer["target"], answer["outcome"]] += 1
        if answer["outcome"] != "defect":
            return
        alike = tally.defects.setdefault((answer["target"], answer["kind"]), [])
        alike.append(answer)
        if len(alike) > KEPT_OF_A_KIND:
            return
        kept = out / f"{sum(map(len, tally.defects.values())):04d}-{answer['target']}"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(place / "case", kept / "files", symlinks=True)
        answer["repeat"] = f"python tests/fuzzing.py repeat {kept}"
        (kept / "case.json").write_text(json.dumps(answer, indent=1))
        if len(alike) == 1:
            print(f"{answer['target']}: {answer['kind']}\n    {answer['repeat']}", flush=True)

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, ThreadPoolExecutor(jobs) as pool:
        list(pool.map(serve, [Path(folder, str(k)) for k in range(jobs)]))
    return tally


def repeat(kept: Path) -> int:
    """Do a kept case again in this process, and show what happens, with its traceback."""
    kept = kept.parent if kept.name == "case.json" else kept
    about = json.loads((kept / "case.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case"
        shutil.copytree(kept / "files", case)
        tempfile.tempdir = str(Path(folder) / secrets.token_hex(4))
        os.mkdir(tempfile.tempdir)
        verdict = judge(targets()[about["target"]], case, about["entry"])
        tempfile.tempdir = None
    print(f"{about['target']} of {about['entry']}, from {about['of']}: {verdict.outcome} {verdict.kind}\n{verdict.text}")
    return int(verdict.outcome == "defect")


def report(tally: Tally, seconds: float) -> int:
    """Print what came of the cases; return 1 if there are defects."""
    names = sorted({name for name, _ in tally.counts})
    print(f"{'':24}{'read':>8}{'refused':>9}{'defects':>9}")
    for name in names:
        print(
            f"{name:24}"
            + "".join(f"{tally.counts[name, outcome]:>{w}}" for outcome, w in (("read", 8), ("refused", 9), ("defect", 9)))
        )
    for fault in tally.faulty_seeds:
        print(f"the seed {fault['seed']!r} itself, {fault['target']}: {fault['kind']}\n    {fault['text'][-600:]}")
    for (target, kind), found in sorted(tally.defects.items(), key=lambda item: -len(item[1])):
        print(f"{len(found):5} {target}: {kind}   {found[0].get('repeat', '').split()[-1]}")
    total = sum(tally.counts.values())
    many = sum(map(len, tally.defects.values()))
    print(f"{total} inputs, {many} defects of {len(tally.defects)} kinds, {seconds:.0f} seconds")
    return int(bool(many or tally.faulty_seeds))


def main() -> int:
    words = sys.argv[1:]
    if words[:1] == ["work"]:
        work(Path(words[1]), int(words[2]))
        return 0
    if words[:1] == ["repeat"]:
        return repeat(Path(words[1]))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, help="how long to go on; default 60 if there is no count")
    parser.add_argument("--count", type=int, help="number of inputs")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same inputs")
    parser.add_argument("--jobs", type=int, default=min(os.cpu_count() or 1, 4), help="number of processes")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="folder for the defects' files")
    given = parser.parse_args(words)
    seconds = 60.0 if given.seconds is None and given.count is None else given.seconds
    started = time.monotonic()
    shutil.rmtree(given.out, ignore_errors=True)
    given.out.mkdir(parents=True)
    tally = fuzz(given.seed, given.out, count=given.count, seconds=seconds, jobs=given.jobs)
    return report(tally, time.monotonic() - started)


if __name__ == "__main__":
    raise SystemExit(main())
