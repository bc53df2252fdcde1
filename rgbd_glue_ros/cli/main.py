"""``rgbd-glue``: the command line; the only place that prints and that exits the process."""

# Commands import what they need when they run, so that help and errors come at once.
# ruff: noqa: PLC0415

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from rgbd_glue_ros.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from rgbd_glue_ros.evaluation.trajectory_errors import Evaluation
    from rgbd_glue_ros.experiments.pairs.methods import Estimator
    from rgbd_glue_ros.experiments.pairs.paper_tables import PaperTable
    from rgbd_glue_ros.parameters import Config
    from rgbd_glue_ros.recordings import Recording
    from rgbd_glue_ros.types import OdometryEstimate

logger = logging.getLogger(__name__)

PROGRAM = "rgbd-glue"

OK, FAILED, BAD_INPUT = 0, 1, 2
# what a shell sees of a program that ended by SIGINT or SIGPIPE
INTERRUPTED, BROKEN_PIPE = 128 + 2, 128 + 13


@dataclass(frozen=True)
class Command:
    """A subcommand.

    Attributes:
        name: on the command line.
        summary: one line for the help.
        add_arguments: declares its arguments.
        run: does it and returns what to print; raises InputError or MissingExtraError for what
            the user can mend.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], str]


class _Parser(argparse.ArgumentParser):
    """Says what is wrong with the arguments in one line, where argparse prints the usage too."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{PROGRAM}: {message}; see {self.prog} --help\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program.

    Args:
        arguments: of the command line; None takes the process's.

    Returns:
        The exit code: 2 for bad input, 1 for a failure inside.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    args = _parser(words).parse_args(words)
    args.words = words
    logging.basicConfig(format=f"{PROGRAM}: %(levelname)s: %(message)s")
    # what Ctrl-C leaves in order (results written, the demonstration's node ended), a kill does too
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.stdout.write(args.command.run(args))
        sys.stdout.flush()
    except (InputError, MissingExtraError) as error:
        return _fail(error, str(error), BAD_INPUT, debug=args.debug)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader went away, as in `| head`: keep Python from flushing into nothing at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except Exception as error:  # noqa: BLE001 - the user gets one line, not a traceback
        text = f"failure inside: {type(error).__name__}: {error}; --debug shows where"
        return _fail(error, text, FAILED, debug=args.debug)
    return OK


def _fail(error: Exception, text: str, code: int, *, debug: bool) -> int:
    if debug:
        logger.error("traceback:", exc_info=error)
    sys.stderr.write(f"{PROGRAM}: {' '.join(text.split())}\n")
    return code


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    common = _Parser(add_help=False)
    common.add_argument("--debug", action="store_true", help="show where an error arose")
    parser = _Parser(
        PROGRAM, description="RGB-D odometry by RGBD-Glue: replay, evaluate, convert, measure."
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    chosen = next((word for word in words if not word.startswith("-")), None)
    for command in COMMANDS:
        child = commands.add_parser(
            command.name,
            help=command.summary,
            description=command.summary[0].upper() + command.summary[1:] + ".",
            parents=[common],
        )
        child.set_defaults(command=command)
        if command.name == chosen:
            command.add_arguments(child)
    return parser


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        try:
            version = metadata.version("rgbd_glue_ros")
        except metadata.PackageNotFoundError:
            version = "(not installed)"
        sys.stdout.write(f"{PROGRAM} {version}\n")
        parser.exit()


_RECORDING = "a bag (rosbag2 folder, .mcap, .db3, .bag), a .sens file or a folder of a data set"


def _add_recording(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", metavar="SRC", type=Path, help=_RECORDING)
    _add_topics(parser)


def _add_topics(parser: argparse.ArgumentParser) -> None:
    for kind, what in (
        ("color", "colour images"),
        ("depth", "depth images"),
        ("info", "camera infos"),
        ("truth", "true poses"),
    ):
        parser.add_argument(
            f"--{kind}-topic",
            metavar="TOPIC",
            help=f"topic of a bag's {what} in place of the one found by type and name",
        )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        help="camera info (YAML or JSON) in place of the recording's",
    )


def _add_recordings(parser: argparse.ArgumentParser, least: Literal["+", "*"] = "+") -> None:
    parser.add_argument(
        "recordings", metavar="SRC", type=Path, nargs=least, help=f"{_RECORDING}, or one of many"
    )
    parser.add_argument(
        "--only",
        metavar="SPLIT",
        help="of many recordings those of an official split (3dmatch-test, 7-scenes-test, "
        "scannet-v2-test), or those named in a file, one a line",
    )
    _add_topics(parser)


def _add_workers(parser: argparse.ArgumentParser) -> None:
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        metavar="N",
        type=_positive,
        help="work in N processes on this machine (needs the extra scale)",
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="work on a Dask cluster, such as tcp://host:8786; its workers have to see the same "
        "files",
    )


def _recordings(args: argparse.Namespace) -> list[Path]:
    from rgbd_glue_ros.recordings import recordings, split

    return recordings(args.recordings, split(args.only) if args.only else None)


def _opener(args: argparse.Namespace) -> Callable[[Path], Recording]:
    """Opens recordings as the arguments say, in this process or another."""
    from rgbd_glue_ros.recordings import Topics, load_calibration, open_recording

    topics = Topics(args.color_topic, args.depth_topic, args.info_topic, args.truth_topic)
    calibration = load_calibration(args.calibration) if args.calibration else None
    return partial(open_recording, topics=topics, calibration=calibration)


def _open(args: argparse.Namespace, path: Path) -> Recording:
    return _opener(args)(path)


def _add_config(parser: argparse.ArgumentParser, preset: str = "live") -> None:
    parser.add_argument(
        "--preset",
        default=preset,
        help="preset to start from: live or paper (default: %(default)s)",
    )
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="set a parameter, as in --set glue.k=3; may be repeated",
    )


def _config(args: argparse.Namespace) -> Config:
    from rgbd_glue_ros.parameters import load_preset, parse_assignment, with_values

    return with_values(load_preset(args.preset), dict(map(parse_assignment, args.set)))


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above zero")
    return int(text)


def _positive_number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no number above zero")
    return number


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        default=Path("out/demo"),
        help="where the results go (default: %(default)s)",
    )
    parser.add_argument(
        "--rate",
        type=_positive_number,
        default=1.0,
        help="speed of the recording (default: %(default)s)",
    )


def _demo(args: argparse.Namespace) -> str:
    from tqdm import tqdm

    from rgbd_glue_ros.experiments.demo.demo import Progress, bundled_bag, demo
    from rgbd_glue_ros.experiments.replay.replay import REPORT

    with tqdm(unit=" frames", disable=None, dynamic_ncols=True, desc="waiting for the node") as bar:

        def show(progress: Progress) -> None:
            bar.total = progress.frames
            bar.set_description("playing", refresh=False)
            bar.set_postfix_str(f"{progress.poses} poses", refresh=False)
            bar.update(progress.played - bar.n)

        result = demo(bundled_bag(), args.output, args.rate, show)
    said = f"node     {result.summary}\n" if result.summary else ""
    return f"{_summary(result.figures)}{said}report   {args.output / REPORT}\n"


def _add_replay(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser)
    _add_config(parser)
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="where the results go"
    )
    parser.add_argument(
        "--ground-truth",
        metavar="FILE",
        type=Path,
        help="true trajectory (TUM format) in place of the recording's",
    )
    parser.add_argument("--limit", metavar="N", type=_positive, help="stop after N frames")
    _add_workers(parser)


def _replay(args: argparse.Namespace) -> str:
    sources = _recordings(args)
    return _replay_one(args, sources[0]) if len(sources) == 1 else _replay_many(args, sources)


def _replay_many(args: argparse.Namespace, sources: list[Path]) -> str:
    from tqdm import tqdm

    from rgbd_glue_ros.experiments.batch.workers import pool
    from rgbd_glue_ros.experiments.replay.batch import TABLE, run_replays

    if args.ground_truth:
        raise InputError("--ground-truth", "is of one recording", "give one SRC")
    config = _config(args)
    with (
        pool(args.workers, args.scheduler) as workers,
        tqdm(total=len(sources), unit=" recordings", disable=None, dynamic_ncols=True) as bar,
    ):

        def expect(_: int, done: int) -> None:
            bar.update(done)
            if done:
                logger.warning("going on after %d recordings that an earlier run left", done)

        def step(name: str) -> None:
            bar.set_postfix_str(name, refresh=False)
            bar.update()

        run_replays(
            sources,
            _opener(args),
            config,
            args.output,
            pool=workers,
            limit=args.limit,
            on_planned=expect,
            on_replayed=step,
        )
    table = args.output / TABLE
    return f"{table.read_text(encoding='utf-8')}table    {table}\n"


def _replay_one(args: argparse.Namespace, source: Path) -> str:
    from tqdm import tqdm

    from rgbd_glue_ros.evaluation.trajectory import read_tum
    from rgbd_glue_ros.experiments.replay.replay import METRICS, REPORT, replay

    config = _config(args)
    truth = read_tum(args.ground_truth) if args.ground_truth else None
    with _open(args, source) as recording:
        total = min(recording.frame_count, args.limit or recording.frame_count)
        # None: no bar where nobody watches
        with tqdm(total=total, unit=" frames", disable=None, dynamic_ncols=True) as bar:

            def show(estimate: OdometryEstimate) -> None:
                bar.set_postfix_str(estimate.state.value, refresh=False)
                bar.update()

            try:
                replay(
                    recording,
                    config,
                    args.output,
                    ground_truth=truth,
                    limit=args.limit,
                    on_frame=show,
                )
            except KeyboardInterrupt:
                bar.close()
                logger.warning("interrupted; what was done is in %s", args.output)
                raise
    figures = json.loads((args.output / METRICS).read_text(encoding="utf-8"))
    return f"{_summary(figures)}report   {args.output / REPORT}\n"


def _summary(figures: dict[str, Any]) -> str:
    frames = "{frames}, of which {tracked} tracked and {lost} lost; {keyframes} keyframes"
    speed = "{fps:.1f} frames/s; latency {p50:.1f} ms, p95 {p95:.1f} ms"
    text = f"frames   {frames.format(**figures)}\n"
    text += f"path     {figures['path_m']:.2f} m\n"
    text += f"speed    {speed.format(fps=figures['fps'], **figures['latency_ms'])}\n"
    if "ape" in figures:
        text += f"APE      {figures['ape']['rmse_m']:.4f} m rmse, SE(3) aligned\n"
    if figures.get("rpe"):
        rpe = "{trans_rmse_m:.4f} m, {rot_rmse_deg:.3f} deg rmse over {delta_s:g} s"
        text += f"RPE      {rpe.format(**figures['rpe'])}\n"
    return text


def _add_evaluate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("estimate", metavar="EST", type=Path, help="trajectory (TUM format)")
    parser.add_argument("reference", metavar="REF", type=Path, help="true trajectory (TUM format)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def _evaluate(args: argparse.Namespace) -> str:
    from rgbd_glue_ros.evaluation.trajectory import read_tum
    from rgbd_glue_ros.evaluation.trajectory_errors import evaluate

    evaluation = evaluate(read_tum(args.estimate), read_tum(args.reference))
    return _json(evaluation) if args.json else _table(evaluation)


def _json(evaluation: Evaluation) -> str:
    content = {
        "poses": len(evaluation.stamps_ns),
        "ape": asdict(evaluation.ape),
        "rpe": asdict(evaluation.rpe) if evaluation.rpe else None,
    }
    return json.dumps(content, indent=2) + "\n"


def _table(evaluation: Evaluation) -> str:
    ape, rpe = evaluation.ape, evaluation.rpe
    rows = [
        f"{len(evaluation.stamps_ns)} poses, paired one-to-one by time",
        "APE, SE(3) aligned (m)",
        f"  rmse    {ape.rmse_m:.6f}",
        f"  mean    {ape.mean_m:.6f}",
        f"  median  {ape.median_m:.6f}",
        f"  max     {ape.max_m:.6f}",
    ]
    if rpe is None:
        rows.append("RPE: the trajectory is too short")
    else:
        rows += [
            f"RPE over {rpe.delta_s:g} s, rmse",
            f"  translation  {rpe.trans_rmse_m:.6f} m",
            f"  rotation     {rpe.rot_rmse_deg:.6f} deg",
        ]
    return "\n".join(rows) + "\n"


def _add_convert(parser: argparse.ArgumentParser) -> None:
    _add_recording(parser)
    parser.add_argument("target", metavar="DST", type=Path, help="new folder to write to")
    parser.add_argument(
        "--compressed",
        action="store_true",
        help="write JPEG and compressedDepth to a bag in place of raw images, which lose nothing",
    )


def _convert(args: argparse.Namespace) -> str:
    from rgbd_glue_ros.recordings.convert import convert

    with _open(args, args.recording) as recording:
        convert(recording, args.target, args.compressed)
    return f"written: {args.target}\n"


def _add_pairs(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser, least="*")
    parser.add_argument(
        "--data",
        metavar="SRC",
        type=Path,
        action="append",
        default=[],
        help="the same as SRC",
    )
    _add_config(parser, preset="paper")
    parser.add_argument(
        "--gap",
        metavar="N",
        type=_positive,
        action="append",
        help="frames between the two of a pair (default: 20); may be repeated",
    )
    parser.add_argument(
        "--every",
        metavar="N",
        type=_positive,
        help="start a pair at every N-th frame (default: the gap)",
    )
    parser.add_argument(
        "--table",
        metavar="NUMBER",
        help="fill in a table of the paper, 1 to 6 or S1 to S3, at its gaps and with its methods",
    )
    parser.add_argument(
        "--peers",
        metavar="NAMES",
        default="",
        help="methods of others to measure on the same pairs, with commas between, or all",
    )
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="where the results go"
    )
    _add_workers(parser)


def _pairs(args: argparse.Namespace) -> str:
    from tqdm import tqdm

    from rgbd_glue_ros.experiments.batch.workers import pool
    from rgbd_glue_ros.experiments.pairs.experiment import REPORT, TABLES, Experiment, run_pairs

    table = _paper_table(args)
    config = _config(args)
    others: dict[str, Estimator] = {peer: peer for peer in _peers(args.peers)}
    others |= table.estimators(config)[0] if table else {}
    # a row that is the configuration itself is measured already
    others = {name: other for name, other in others.items() if other != config}
    gaps = sorted({*(args.gap or (table.gaps if table else [20]))})
    experiment = Experiment(config, gaps, args.every, others)
    args.recordings += args.data
    if not args.recordings:
        raise InputError("pairs", "no recording is given", "name a data set or a bag")
    sources = _recordings(args)
    with (
        pool(args.workers, args.scheduler) as workers,
        tqdm(total=0, unit=" pairs", disable=None, dynamic_ncols=True) as bar,
    ):

        def expect(total: int, done: int) -> None:
            bar.total, bar.initial = total, done
            bar.update(done)
            if done:
                logger.warning("going on after %d pairs that an earlier run left", done)

        def step(_: object) -> None:
            bar.update()

        try:
            figures = run_pairs(
                sources,
                _opener(args),
                experiment,
                args.output,
                pool=workers,
                on_planned=expect,
                on_pair=step,
            )
        except KeyboardInterrupt:
            bar.close()
            if experiment.results:
                logger.warning(
                    "interrupted; what was done is in %s, and the same command goes on",
                    args.output,
                )
            raise
    summary = _pairs_summary(figures)
    summary += f"tables   {args.output / TABLES}\nreport   {args.output / REPORT}\n"
    return summary if table is None else summary + _write_table(table, config, figures, args.output)


def _paper_table(args: argparse.Namespace) -> PaperTable | None:
    from rgbd_glue_ros.experiments.pairs.paper_tables import paper_table

    return paper_table(args.table) if args.table else None


def _write_table(table: PaperTable, config: Config, figures: dict[str, Any], folder: Path) -> str:
    from rgbd_glue_ros.experiments.pairs.paper_tables import render

    estimators, absent = table.estimators(config)
    measured = {
        name: figures["gaps"] if estimator == config else figures["others"][name]["gaps"]
        for name, estimator in estimators.items()
        if name not in figures["absent"]
    }
    text = render(table, measured, {**figures["absent"], **absent}, figures["sources"])
    path = folder / f"table_{table.number}.md"
    path.write_text(text, encoding="utf-8")
    return f"table    {path}\n\n{text}"


def _peers(text: str) -> list[str]:
    from rgbd_glue_ros.experiments.peers import PEERS

    names = list(PEERS) if text == "all" else [name for name in text.split(",") if name]
    for name in names:
        if name not in PEERS:
            raise InputError(
                f"--peers {name}", "no such peer", f"take all, or some of {', '.join(PEERS)}"
            )
    return names


def _pairs_summary(figures: dict[str, Any]) -> str:
    lines = []
    for gap, content in figures["gaps"].items():
        mean = "{rotation_deg[mean]:.2f} deg, {translation_cm[mean]:.2f} cm, {chamfer_mm[mean]:.2f}"
        lines.append(
            f"gap {gap:<4} {content['pairs']} pairs, {content['failed']} failed; mean error "
            f"{mean.format(**content)} mm chamfer; {content['seconds_per_pair']:.2f} s/pair\n"
        )
    return "".join(lines)


def _add_fetch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help="data set, such as tum/fr1_desk; without any, all that can be fetched are listed",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        default=Path("data"),
        help="where its folder goes (default: %(default)s)",
    )
    parser.add_argument(
        "--sha256",
        metavar="HEX",
        help="checksum that the archive must have; for one NAME",
    )


def _fetch(args: argparse.Namespace) -> str:
    from tqdm import tqdm

    from rgbd_glue_ros.recordings.fetch import CATALOGUE, Source, fetch, find

    if not args.names:
        width = max(map(len, CATALOGUE))
        lines = [f"{s.name:<{width}}  {s.licence:<25}  {s.url}\n" for s in CATALOGUE.values()]
        return "".join(lines)
    sources = [find(name) for name in args.names]
    if args.sha256:
        if len(sources) > 1:
            raise InputError("--sha256", "is of one archive", "give one NAME")
        sources = [replace(sources[0], sha256=args.sha256)]

    def fetched(source: Source) -> str:
        bytes_of = partial(
            tqdm, unit="B", unit_scale=True, unit_divisor=1024, disable=None, dynamic_ncols=True
        )
        with bytes_of(desc=source.name) as down, bytes_of(desc="unpacked", position=1) as out:

            def downloaded(there: int, total: int | None) -> None:
                down.total = total
                down.update(there - down.n)

            def unpacked(more: int) -> None:
                out.update(more)

            result = fetch(source, args.output, on_download=downloaded, on_unpack=unpacked)
        return (
            f"{result.folder}  from {result.url}\n"
            f"  {result.licence}; {result.bytes} bytes, SHA-256 {result.sha256}\n"
        )

    try:
        return "".join(map(fetched, sources))
    except KeyboardInterrupt:
        logger.warning("interrupted; run this again, it goes on from there")
        raise


def _add_bench(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        metavar="SRC",
        type=Path,
        nargs="*",
        help=f"{_RECORDING}; the bundled recording if none is given",
    )
    _add_topics(parser)
    _add_config(parser)
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=Path, required=True, help="where the results go"
    )
    parser.add_argument("--limit", metavar="N", type=_positive, help="stop after N frames")
    parser.add_argument(
        "--peer",
        metavar="NAME",
        action="append",
        help="peer to measure beside ours (default: those for odometry); may be repeated",
    )
    parser.add_argument(
        "--patience",
        metavar="S",
        type=_positive_number,
        default=120.0,
        help="seconds for each peer and recording; what it got done by then counts "
        "(default: %(default)g)",
    )
    parser.add_argument(
        "--robustness",
        action="store_true",
        help="also with frames missing, dark, blind or patchy, or with somebody in them",
    )
    parser.add_argument(
        "--live", action="store_true", help="also played to the node over DDS, at its own rate"
    )
    parser.add_argument(
        "--memory",
        metavar="N",
        type=_positive,
        default=0,
        help="also watch the memory over N frames of the first recording, over and over",
    )


def _bench(args: argparse.Namespace) -> str:
    import shlex

    from tqdm import tqdm

    from rgbd_glue_ros.experiments.bench import ODOMETRIES, TABLES, Plan, run_bench
    from rgbd_glue_ros.experiments.bench.part import Part
    from rgbd_glue_ros.experiments.demo.demo import bundled_bag
    from rgbd_glue_ros.recordings import recordings

    plan = Plan(
        _config(args),
        args.peer or ODOMETRIES,
        args.limit,
        args.patience,
        args.robustness,
        args.live,
        args.memory,
        command=shlex.join([PROGRAM, *args.words]),
    )
    with tqdm(total=0, unit=" frames", disable=None, dynamic_ncols=True) as bar:

        def begin(part: Part, recording: Recording) -> None:
            bar.reset(part.frame_count)
            bar.set_description(f"{recording.name}, {part.title}")

        def step() -> None:
            bar.update()

        try:
            run_bench(
                recordings(args.recordings or [bundled_bag()]),
                _opener(args),
                plan,
                args.output,
                on_part=begin,
                on_frame=step,
            )
        except KeyboardInterrupt:
            bar.close()
            logger.warning("interrupted; what was measured is in %s", args.output)
            raise
    return (
        f"{(args.output / TABLES).read_text(encoding='utf-8')}\ntables   {args.output / TABLES}\n"
    )


def _add_params(parser: argparse.ArgumentParser) -> None:
    _add_config(parser)
    parser.add_argument("--markdown", action="store_true", help="print a table, not YAML")


def _params(args: argparse.Namespace) -> str:
    from rgbd_glue_ros.parameters import to_markdown, to_yaml

    config = _config(args)
    return to_markdown(config) if args.markdown else to_yaml(config)


COMMANDS = (
    Command("demo", "play the bundled bag to the node over DDS", _add_demo, _demo),
    Command("replay", "run the odometry over a recording", _add_replay, _replay),
    Command("evaluate", "compare a trajectory with the truth", _add_evaluate, _evaluate),
    Command(
        "convert",
        "turn a data set into a rosbag2, or a bag into a TUM RGB-D folder",
        _add_convert,
        _convert,
    ),
    Command("pairs", "register pairs of frames as in the paper's experiments", _add_pairs, _pairs),
    Command("fetch", "download public data sets", _add_fetch, _fetch),
    Command("bench", "measure speed and error beside others, in one run", _add_bench, _bench),
    Command("params", "print all parameters with unit, range and meaning", _add_params, _params),
)
