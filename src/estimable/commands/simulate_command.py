"""`estimable simulate`: a record of a plant behind links that lose packets, or flights in which the elevator fails."""

from pathlib import Path
from typing import Annotated

import typer

from . import options, show, simulate_flight, simulate_report, simulate_world
from .destination import check_destination

What = Annotated[
    str, typer.Argument(metavar="MODEL", help="What to simulate: output-error, f16 or multirotor.", show_default=False)
]
Rows = Annotated[int, typer.Option("--rows", metavar="N", help="Number of samples.")]
Seed = Annotated[int, typer.Option("--seed", metavar="N", help="The same seed gives the same record.")]
Arrival = "The fraction of the {} packets that arrive."
InputArrival = Annotated[float, typer.Option("--input-arrival", metavar="RATE", help=Arrival.format("input"))]
OutputArrival = Annotated[float, typer.Option("--output-arrival", metavar="RATE", help=Arrival.format("output"))]
Burst = Annotated[
    float, typer.Option("--burst", metavar="N", help="Mean length of a burst of losses; 0: independent losses.")
]
Loss = Annotated[
    float | None,
    typer.Option("--loss", metavar="FRACTION", help="f16: the lost fraction of the elevator's effect.", show_default=False),
]  # fmt: skip
Runs = Annotated[
    int | None, typer.Option("--runs", metavar="N", help="f16: number of flights (default 200, JSBSim 1).", show_default=False)
]  # fmt: skip
Plant = Annotated[
    str | None,
    typer.Option("--plant", metavar="NAME", show_default=False,
                 help="f16: short-period (default), jsbsim, or jsbsim-untrimmed, in which the loss also changes the trim."),
]  # fmt: skip
Folder = Annotated[
    Path | None,
    typer.Option("--folder", metavar="PATH", help="f16: a folder for finished parts. The same call then resumes there.",
                 show_default=False),
]  # fmt: skip
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="f16: run on the cluster of this Dask scheduler, such as tcp://10.0.0.1:8786.",
                 show_default=False),
]  # fmt: skip
OutFile = Annotated[
    Path | None, typer.Option("--out", metavar="PATH", help="Write the record to this .csv file.", show_default=False)
]  # fmt: skip
Fault = Annotated[
    list[str] | None,
    typer.Option("--fault", metavar="KIND:CHANNEL@TIME[=VALUE]", show_default=False,
                 help="f16, multirotor: a fault, such as stuck:elevator@4.5. May be repeated."),
]  # fmt: skip
Turbulence = Annotated[
    str | None,
    typer.Option("--turbulence", metavar="SEVERITY", help="f16, multirotor: light, moderate or severe.", show_default=False),
]  # fmt: skip


def simulate(
    what: What,
    rows: Rows = 1000,
    seed: Seed = 0,
    input_arrival: InputArrival = 1.0,
    output_arrival: OutputArrival = 1.0,
    burst: Burst = 0.0,
    lost: options.Lost = None,
    settings: options.Set = None,
    out: OutFile = None,
    loss: Loss = None,
    runs: Runs = None,
    plant: Plant = None,
    folder: Folder = None,
    scheduler: Scheduler = None,
    fault: Fault = None,
    turbulence: Turbulence = None,
    machine: options.Machine = False,
) -> None:
    """Simulate a record over lossy links, or a failing F-16.

    `estimable simulate output-error` simulates a linear plant whose inputs and outputs are sent over a network. The plant is
    that of Fang (2009), section 3.5. --set changes its a, b, delay, noise_variance and dt. The input is uniform, with zero
    mean and unit variance. The record has the columns time, u (the input that was sent), arrived, and y (empty if it was
    lost), as `estimable identify` reads them.

    `estimable simulate f16` simulates flights with three pitch doublets, in which the elevator loses a part of its effect.
    It compares a fixed control law with one that is reconfigured when the failure is detected. It shows medians over the
    runs: the RMS difference of the pitch rate from the flight without a failure, and the time until the failure is detected.

    With --fault, --turbulence or --out, `estimable simulate f16` simulates one flight under the fixed law instead. It writes
    the record (commands, measured positions, outputs) and, next to it, a .json file with the events, the true states and the
    true positions. A fault is KIND:CHANNEL@TIME, with =VALUE or @TIME-UNTIL where the kind has one. Kinds of an input:
    effectiveness, stuck, floating, hard-over, offset, rate, limits, bandwidth, delay; of a state: upset, gust; of an output:
    bias, scale, drift, noise, frozen, dropout. The beginning of a channel's name is enough. `estimable simulate multirotor`
    does the same with a quadrotor, which follows roll doublets for 20 s, and `--plant jsbsim` with the F-16 of JSBSim.

    \b
    Example:
      estimable simulate output-error --input-arrival 0.8 --output-arrival 0.7 --seed 1 --out run.csv
      estimable identify run.csv --method recursive-output-error
      estimable simulate f16 --loss 0.8 --runs 200
      estimable simulate f16 --plant jsbsim --loss 0.5
      estimable simulate f16 --fault stuck:elevator@4.5 --fault bias:pitch_rate@3-4=1 --seed 1 --out F.csv
      estimable simulate multirotor --fault effectiveness:motor3@14.2=0.7 --turbulence light --out quad.csv
    """
    if what == "multirotor" or (what == "f16" and (fault or turbulence or out)):
        refused = {"loss": loss, "runs": runs, "folder": folder, "scheduler": scheduler, "lost": lost,
                   "set": settings, "rows": None if rows == 1000 else rows}  # fmt: skip
        simulate_world.run(
            what, plant, out, seed=seed, faults_given=fault or (), turbulence=turbulence,
            arrivals=(input_arrival, output_arrival), burst=burst, refused=refused, machine=machine,
        )  # fmt: skip
        return
    if what == "f16":
        rest = {"rows": rows, "lost": lost, "settings": settings, "out": out}
        numbers = simulate_flight.flown(
            0.5 if loss is None else loss, plant or "short-period", runs=runs, seed=seed,
            arrivals=(input_arrival, output_arrival), burst=burst, rest=rest,
            where={"folder": folder, "scheduler": scheduler},
        )  # fmt: skip
        if machine:
            show.data("simulate", simulate_flight.as_data(numbers))
        else:
            show.text(lambda _: simulate_flight.as_text(numbers))
        return
    flights = {"loss": loss, "runs": runs, "plant": plant, "folder": folder, "scheduler": scheduler}
    simulate_flight.refuse_options({**flights, "fault": fault and fault[0], "turbulence": turbulence})
    check_destination("--out", out, ".csv")
    simulation = simulate_report.simulated(
        what, rows=rows, seed=seed, arrivals=(input_arrival, output_arrival), burst=burst, lost=lost or "zero",
        settings=settings or (),
    )  # fmt: skip
    written = None if out is None else simulate_report.write(simulation, out)
    if machine:
        show.data("simulate", simulate_report.as_data(simulation, seed, out))
    else:
        show.text(lambda _: simulate_report.as_text(simulation))
    if written is not None:
        show.notes(written)
