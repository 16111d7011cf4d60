"""Draws the paper's figures 4 and 6 to 8 from the results of a run, with ParaView:

    pvpython cases/atps-descent/paraview/figures.py runs/atps-descent [FOLDER]

Without a display: xvfb-run -a -s "-screen 0 1600x1200x24" pvpython ... (on Debian: packages paraview,
xvfb, libgl1-mesa-dri). The pictures are written to FOLDER, by default RUN/figures. A figure whose
results the run did not write is left out, with the reason. `--flow STAGE` takes the slices of figures 6 and 7
from another stage than the last one with a flow.
"""

import argparse
import os
import sys

from paraview import simple as pv

pv._DisableFirstRenderCameraReset()

# Times of figure 4 in the pre-inflation, s; the last shape follows.
SHAPES = [0.0, 0.2, 0.4, 0.8]
# Figure 8: near-steady descent speeds of the paper and of its reference 1, m/s.
PUBLISHED = [("paper 4.69392", 4.69392), ("Sathe et al. 4.78536", 4.78536)]
INK = [0.13, 0.15, 0.18]


def series(run, stage, name):
    """Reader and times of a series of a stage; None if it was not written."""
    path = os.path.join(run, stage, name)
    if not os.path.isfile(path):
        return None
    reader = pv.PVDReader(FileName=path)
    reader.UpdatePipelineInformation()
    times = list(reader.TimestepValues) if hasattr(reader.TimestepValues, "__len__") else [reader.TimestepValues]
    return (reader, times) if times else None


def nearest(times, wanted):
    return min(times, key=lambda t: abs(t - wanted))


def frozen(source, time):
    """A source that stays at one time, so that pictures of several times stand next to each other."""
    still = pv.ForceTime(Input=source)
    still.ForcedTime = time
    still.UpdatePipeline(time)
    return still


def view(layout_size):
    made = pv.CreateView("RenderView")
    made.UseColorPaletteForBackground = 0
    made.Background = [1, 1, 1]
    made.OrientationAxesVisibility = 0
    made.ViewSize = layout_size
    made.CameraParallelProjection = 1
    return made


def look(made, centre, direction, scale, up=(0, 0, 1)):
    made.CameraFocalPoint = list(centre)
    made.CameraPosition = [c + 60 * d for c, d in zip(centre, direction)]
    made.CameraViewUp = list(up)
    made.CameraParallelScale = scale


def label(made, text, tone=INK):
    note = pv.Text(Text=text)
    shown = pv.Show(note, made)
    shown.Color = tone
    shown.FontSize = 15
    shown.WindowLocation = "Upper Center"


def colour(shown, source, field, preset, low, high, made, title, bar):
    pv.ColorBy(shown, field)
    table = pv.GetColorTransferFunction(field[1])
    table.ApplyPreset(preset, True)
    table.RescaleTransferFunction(low, high)
    shown.LookupTable = table
    if field[1].startswith("velocity"):
        table.VectorMode = "Magnitude"
    if bar:
        legend = pv.GetScalarBar(table, made)
        legend.Title = title
        legend.ComponentTitle = ""
        legend.TitleColor = legend.LabelColor = INK
        legend.TitleFontSize = legend.LabelFontSize = 14
        legend.Orientation = "Horizontal"
        legend.WindowLocation = "Lower Center"
        legend.ScalarBarLength = 0.5
        legend.RangeLabelFormat = legend.LabelFormat = "%.3g"
        legend.AutomaticLabelFormat = 0
        legend.Visibility = 1


def save(views, columns, size, path):
    """Views as one picture, in rows of so many columns."""
    layout = pv.CreateLayout(os.path.basename(path))
    rows = [views[i:i + columns] for i in range(0, len(views), columns)]
    at = 0
    heads = []
    for row in range(len(rows)):
        heads.append(at)
        if row + 1 < len(rows):
            layout.SplitVertical(at, 1.0 / (len(rows) - row))
            heads[-1], at = 2 * at + 1, 2 * at + 2
    for row, head in zip(rows, heads):
        at = head
        for column, made in enumerate(row):
            if column + 1 < len(row):
                layout.SplitHorizontal(at, 1.0 / (len(row) - column))
                layout.AssignView(2 * at + 1, made)
                at = 2 * at + 2
            else:
                layout.AssignView(at, made)
    layout.SetSize(*size)
    pv.SaveScreenshot(path, layout, ImageResolution=list(size), CompressionLevel="9")
    pv.RemoveLayout(layout)
    print(path)


def canopy(run, stage, time, made, low, high, bar):
    """Canopy and lines in a view, coloured by the major stress."""
    fabric, times = series(run, stage, "canopy.pvd")
    at = nearest(times, time)
    shape = frozen(fabric, at)
    stress = pv.Calculator(Input=shape, AttributeType="Cell Data", ResultArrayName="major stress",
                           Function="stress_1_pa*1e-6")
    shown = pv.Show(stress, made)
    colour(shown, stress, ("CELLS", "major stress"), "Viridis (matplotlib)", low, high, made,
           "major stress, MPa", bar)
    lines = series(run, stage, "lines.pvd")
    if lines:
        shown = pv.Show(frozen(lines[0], at), made)
        pv.ColorBy(shown, None)
        shown.DiffuseColor = shown.AmbientColor = INK
        shown.LineWidth = 1.5
    return at


def box(run, stage, time, name="canopy.pvd"):
    fabric, times = series(run, stage, name)
    shape = frozen(fabric, nearest(times, time))
    shape.UpdatePipeline()
    return shape.GetDataInformation().GetBounds()


def figure_4(run, stage, out):
    """Pre-inflation: the unstressed cut, its opening, and the shape that it comes to."""
    fabric = series(run, stage, "canopy.pvd")
    if not fabric:
        return f"stage {stage} wrote no canopy.pvd (output.surface_every_windows)"
    times = SHAPES + [fabric[1][-1]]
    views = []
    boxes = [box(run, stage, t) for t in times]
    lines = series(run, stage, "lines.pvd")
    boxes += [box(run, stage, t, "lines.pvd") for t in times] if lines else []
    low, high = min(b[4] for b in boxes), max(b[5] for b in boxes)
    wide = max(b[1] - b[0] for b in boxes)
    # Fits 400 x 760 pixels seen at an angle, with a margin for the labels.
    size = max(0.58 * (high - low), 1.3 * wide)
    for number, time in enumerate(times):
        made = view([400, 560])
        # The first snapshot is a few windows old: as near to the unstressed cut as the run has it.
        at = canopy(run, stage, time, made, 0.0, 4.0, number == 2)
        label(made, f"({'abcde'[number]}) {at:.2f} s")
        look(made, (0, 0, 0.5 * (low + high)), (0.85, 0.48, -0.2), size)
        views.append(made)
    save(views, 5, (2000, 760), os.path.join(out, "figure-4.png"))


class Cut:
    """A vertical cut through the flow at one time."""

    def __init__(self, run, stage, time):
        reader, times = series(run, stage, "flow.pvd")
        self.time = nearest(times, time)
        whole = pv.MergeBlocks(Input=frozen(reader, self.time), MergePoints=0)
        points = pv.CellDatatoPointData(Input=whole)
        # Slightly off the plane of symmetry, where cells have their faces.
        self.smooth = self.slice(points)
        self.cells = self.slice(whole)

    @staticmethod
    def slice(source):
        cut = pv.Slice(Input=source)
        cut.SliceType = "Plane"
        cut.SliceType.Origin = [0.0, 1e-4, 0.0]
        cut.SliceType.Normal = [0.0, 1.0, 0.0]
        return cut


def canopy_stage(run, stages, stage):
    """The stage whose canopy the flow of a stage goes around."""
    for name in [stage] + stages[: stages.index(stage)][::-1]:
        if series(run, name, "canopy.pvd"):
            return name
    return None


def streamlines(cut, around, made, count):
    """Lines along the air in the plane of the cut, relative to the canopy."""
    [x0, x1, _, _, z0, z1] = around
    flat = pv.SurfaceVectors(Input=cut.smooth)
    flat.SelectInputVectors = ["POINTS", "velocity_frame_m_s"]
    flat.ConstraintMode = "Parallel"
    seeds = pv.Plane(XResolution=count, YResolution=count)
    seeds.Origin, seeds.Point1, seeds.Point2 = [x0, 1e-4, z0], [x1, 1e-4, z0], [x0, 1e-4, z1]
    lines = pv.StreamTracerWithCustomSource(Input=flat, SeedSource=seeds)
    lines.Vectors = ["POINTS", "velocity_frame_m_s"]
    lines.SurfaceStreamlines = 1
    lines.MaximumStreamlineLength = 4 * (x1 - x0)
    lines.IntegrationDirection = "BOTH"
    shown = pv.Show(lines, made)
    pv.ColorBy(shown, None)
    shown.DiffuseColor = shown.AmbientColor = INK
    shown.Opacity = 0.5
    shown.LineWidth = 1.0


def membrane(run, stage, time, made):
    """The cut through the fabric."""
    fabric, times = series(run, stage, "canopy.pvd")
    shown = pv.Show(Cut.slice(frozen(fabric, nearest(times, time))), made)
    pv.ColorBy(shown, None)
    shown.DiffuseColor = shown.AmbientColor = [0, 0, 0]
    shown.LineWidth = 4.0


def around(run, stage, time, wider):
    [x0, x1, _, _, z0, z1] = box(run, stage, time)
    half = 0.5 * (x1 - x0)
    return [-wider * half, wider * half, 0, 0, z0 - 0.9 * half, z1 + 1.6 * half]


def flow_view(run, stages, stage, time, fields, bar, streams):
    """The cut in a view; with streamlines the cells' own values, without them smoothed ones."""
    made = view([800, 760])
    cut = Cut(run, stage, time)
    cloth = canopy_stage(run, stages, stage)
    field, preset, low, high, title = fields
    source, kind = (cut.cells, "CELLS") if streams else (cut.smooth, "POINTS")
    shown = pv.Show(source, made)
    shown.Ambient, shown.Diffuse = 1.0, 0.0
    colour(shown, source, (kind, field), preset, low, high, made, title, bar)
    if cloth:
        time = cut.time if cloth == stage else 1e9
        room = around(run, cloth, time, 1.8)
        if streams:
            streamlines(cut, room, made, streams)
        membrane(run, cloth, time, made)
    else:
        room = [-10, 10, 0, 0, 0, 20]
    middle = 0.5 * (room[4] + room[5])
    look(made, (0, 0, middle), (0, -1, 0), 0.5 * (room[5] - room[4]))
    label(made, f"{cut.time:.2f} s", INK if streams else [1, 1, 1])
    return made, cut, cloth


def figure_6(run, stages, stage, out):
    """The canopy in the moving air, at four times."""
    flow = series(run, stage, "flow.pvd")
    if not flow:
        return f"stage {stage} wrote no flow.pvd (output.volume_every_windows)"
    last = flow[1][-1]
    views = []
    for number, share in enumerate([0.25, 0.5, 0.75, 1.0]):
        fields = ("velocity_frame_m_s", "Viridis (matplotlib)", 0.0, 7.0, "speed relative to the canopy, m/s")
        made, cut, cloth = flow_view(run, stages, stage, share * last, fields, number == 3, 0)
        if cloth:
            canopy(run, cloth, cut.time if cloth == stage else 1e9, made, 0.0, 4.0, False)
            room = around(run, cloth, cut.time if cloth == stage else 1e9, 1.8)
            look(made, (0, 0, 0.5 * (room[4] + room[5]) - 1.0), (0.45, -0.86, 0.12), 0.55 * (room[5] - room[4]))
        views.append(made)
    save(views, 2, (1600, 1300), os.path.join(out, "figure-6.png"))


def figure_7(run, stages, stage, out):
    """Pressure in a vertical cut with the lines along which the air moves, early and late."""
    flow = series(run, stage, "flow.pvd")
    if not flow:
        return f"stage {stage} wrote no flow.pvd (output.volume_every_windows)"
    views = []
    for number, time in enumerate([0.5 * flow[1][-1], flow[1][-1]]):
        fields = ("pressure_pa", "Cool to Warm", -20.0, 20.0, "pressure, Pa")
        made, _, _ = flow_view(run, stages, stage, time, fields, number == 0, 20)
        views.append(made)
    save(views, 2, (1800, 900), os.path.join(out, "figure-7.png"))


def figure_8(run, stage, out):
    """Descent speed over time."""
    path = os.path.join(run, stage, "history.csv")
    if not os.path.isfile(path):
        return f"stage {stage} has no history.csv"
    table = pv.CSVReader(FileName=[path])
    for name, value in PUBLISHED:
        table = pv.Calculator(Input=table, AttributeType="Row Data", ResultArrayName=name,
                              Function=f"{value}+0*time_s")
    table.UpdatePipeline()
    if not table.GetDataInformation().GetRowDataInformation().GetArrayInformation("descent_speed_m_s"):
        return f"stage {stage} has no column descent_speed_m_s"
    chart = pv.CreateView("XYChartView")
    shown = pv.Show(table, chart, "XYChartRepresentation")
    shown.UseIndexForXAxis = 0
    shown.XArrayName = "time_s"
    names = ["descent_speed_m_s"] + [name for name, _ in PUBLISHED]
    shown.SeriesVisibility = names
    shown.SeriesLabel = ["descent_speed_m_s", "this run"] + [n for name, _ in PUBLISHED for n in (name, name)]
    tones = {"descent_speed_m_s": (0.12, 0.36, 0.6), names[1]: (0.72, 0.32, 0.1), names[2]: (0.4, 0.45, 0.5)}
    shown.SeriesColor = [text for name in names for text in (name, *map(str, tones[name]))]
    shown.SeriesLineThickness = [text for name in names for text in (name, "2")]
    chart.BottomAxisTitle, chart.LeftAxisTitle = "time, s", "descent speed, m/s"
    chart.LegendLocation = "BottomRight"
    save([chart], 1, (1100, 620), os.path.join(out, "figure-8.png"))


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("run")
    words.add_argument("out", nargs="?")
    words.add_argument("--flow", metavar="STAGE")
    words = words.parse_args()
    if not os.path.isfile(os.path.join(words.run, "scene.toml")):
        sys.exit(f"{words.run} holds no scene.toml: name the folder of a run's results")
    out = words.out or os.path.join(words.run, "figures")
    os.makedirs(out, exist_ok=True)
    # The stages that ran, in their order.
    with open(os.path.join(words.run, "scene.toml"), encoding="utf-8") as scene:
        lines = scene.read().split("[[stage]]")[1:]
    names = [part.split("name", 1)[1].split('"')[1] for part in lines]
    stages = [name for name in names if os.path.isfile(os.path.join(words.run, name, "history.csv"))]
    if not stages:
        sys.exit(f"{words.run} holds no stage that did a window")
    flow = words.flow or next((s for s in stages[::-1] if series(words.run, s, "flow.pvd")), stages[-1])
    if flow not in stages:
        sys.exit(f"there is no stage {flow}; there are: {', '.join(stages)}")
    for number, why in [
        (4, figure_4(words.run, stages[0], out)),
        (6, figure_6(words.run, stages, flow, out)),
        (7, figure_7(words.run, stages, flow, out)),
        (8, figure_8(words.run, stages[-1], out)),
    ]:
        if why:
            print(f"no figure {number}: {why}")


main()
