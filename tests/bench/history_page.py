"""The page that tests/bench/history.py writes: a plot for each figure over the lines of the history, drawn as SVG."""
import html
import math

STYLE = """
:root { color-scheme: light dark; --bg: #f4f5f7; --panel: #fff; --ink: #18212c; --muted: #566273; --line: #dfe3e9;
  --fail: #a8211a; --s0: #0b6a88; --s1: #c2571a; --s2: #6b4fa3; --s3: #6f7b88; }
@media (prefers-color-scheme: dark) { :root { --bg: #0f1317; --panel: #171c22; --ink: #e4e9ef; --muted: #9ba7b5;
  --line: #2a323b; --fail: #ff8d82; --s0: #63c1dd; --s1: #f0955c; --s2: #b39be8; --s3: #95a1af; } }
body { margin: 0 auto; max-width: 84rem; padding: 1rem; background: var(--bg); color: var(--ink);
  font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.3rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .5rem; }
table { border-collapse: collapse; background: var(--panel); font-variant-numeric: tabular-nums; }
td, th { border: 1px solid var(--line); padding: .2rem .6rem; text-align: left; }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: .7rem; }
figure { margin: 0; padding: .5rem .6rem .2rem; background: var(--panel); border: 1px solid var(--line);
  border-radius: 6px; display: flex; flex-direction: column; justify-content: space-between; }
figcaption { font-size: .83rem; line-height: 1.3; } figcaption small, .muted { color: var(--muted); }
figcaption small, td + td { white-space: nowrap; }
svg { display: block; width: 100%; } svg text { font-size: 10px; fill: var(--muted); }
.grid { stroke: var(--line); } .slow { fill: none; stroke: var(--fail); stroke-width: 2; }
""" + "\n".join(f".s{n} {{ color: var(--s{n}); stroke: var(--s{n}); fill: var(--s{n}); }}" for n in range(4))
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 320, 124, 44, 10, 8, 22


def device_name(line):
    device = line["device"]
    return f"{device['cpu']}, {device['threads']} threads" + (f", {device['gpu']}" if "gpu" in device else "")


def cells(now, before, name):
    """What is said of a slower figure: its name, what it is now, its unit, what it was before and the change."""
    new, old = now["figures"][name], before["figures"][name]

    def shown(figure):
        return f"{figure['median']:.4g} ({figure['low']:.4g} to {figure['high']:.4g})"

    change = f"{100 * (new['median'] / old['median'] - 1):+.0f} %" if old["median"] else ""
    return name, shown(new), new["unit"], shown(old), change


def ticks(low, high):
    """Two to five round values between these, and how many decimals they need."""
    power = 10.0 ** math.floor(math.log10((high - low) / 2))
    step = max(f * power for f in (1, 2, 5) if f * power <= (high - low) / 2)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [n * step for n in range(first, last + 1)], max(0, -math.floor(math.log10(step)))


def plot(lines, name, devices, slow):
    points = [(at, line, line["figures"][name]) for at, line in enumerate(lines) if name in line["figures"]]
    low = min(figure["low"] for _, _, figure in points)
    high = max(figure["high"] for _, _, figure in points)
    margin = max(0.1 * (high - low), 0.05 * abs(high), 1e-9)
    low, high = low - margin, high + margin

    def x(at):
        return LEFT + (WIDTH - LEFT - RIGHT) * ((at + 0.5) / len(lines))

    def y(value):
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low)

    parts = []
    values, decimals = ticks(low, high)
    for value in values:
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>'
                     f'<text x="{LEFT - 4}" y="{y(value) + 3:.1f}" text-anchor="end">{value:.{decimals}f}</text>')
    ends = {0: "start", len(lines) - 1: "end"} if len(lines) > 1 else {0: "start"}
    for at, anchor in ends.items():
        parts.append(f'<text x="{LEFT if at == 0 else WIDTH - RIGHT}" y="{HEIGHT - 4}" text-anchor="{anchor}">'
                     f'{html.escape(lines[at]["commit"])}</text>')
    for number, device in enumerate(devices):
        own = [point for point in points if device_name(point[1]) == device]
        path = " ".join(f"{x(at):.1f},{y(figure['median']):.1f}" for at, _, figure in own)
        parts.append(f'<g class="s{number % 4}"><polyline fill="none" points="{path}"/>')
        for at, line, figure in own:
            middle = f'cx="{x(at):.1f}" cy="{y(figure["median"]):.1f}"'
            said = (f"{line['commit']}, {line['date']}, {device}: {figure['median']:.4g} {figure['unit']} "
                    f"({figure['low']:.4g} to {figure['high']:.4g})")
            parts.append(f'<g><title>{html.escape(said)}</title>'
                         f'<line x1="{x(at):.1f}" x2="{x(at):.1f}" y1="{y(figure["low"]):.1f}" '
                         f'y2="{y(figure["high"]):.1f}"/><circle {middle} r="2.5"/>')
            if any(line is now and name in names for now, _, names in slow):
                parts.append(f'<circle class="slow" {middle} r="6"/>')
            parts.append("</g>")
        parts.append("</g>")
    caption = html.escape(name.split("/", 1)[-1]) + f" <small>{html.escape(points[-1][2]['unit'])}</small>"
    return (f'<figure><figcaption>{caption}</figcaption><svg viewBox="0 0 {WIDTH} {HEIGHT}">{"".join(parts)}</svg>'
            "</figure>")


def page(lines, slow):
    devices = list(dict.fromkeys(device_name(line) for line in lines))
    names = list(dict.fromkeys(name for line in reversed(lines) for name in line["figures"]))
    body = ["<h1>History of the benchmarks</h1><p class=\"muted\">A line a run of <code>make bench-all</code>, oldest "
            "first. Dots are medians, bars their intervals. The axis of a plot does not begin at 0.</p>"]
    for number, device in enumerate(devices):
        last = [line for line in lines if device_name(line) == device][-1]
        body.append(f'<div><b class="s{number % 4}">●</b> {html.escape(device)} <span class="muted">last: '
                    f'{html.escape(last["commit"])}, {html.escape(last["date"])}</span></div>')
    body.append("<h2>Slower than before</h2>")
    for now, before, slower in slow:
        rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in cells(now, before, name))
                       for name in slower)
        body.append(f'<p>{html.escape(device_name(now))}: {html.escape(now["commit"])} against '
                    f'{html.escape(before["commit"])}</p><table><tr><th>figure<th>now: median (interval)<th>unit'
                    f"<th>before: median (interval)<th>change{rows}</table>")
    if not slow:
        body.append("<p>No figure of the newest line of a device is more than 5 % slower than in the line before, with "
                    "an interval that does not overlap.</p>")
    for bench in dict.fromkeys(name.split("/")[0] for name in names):
        plots = "".join(plot(lines, name, devices, slow) for name in names if name.split("/")[0] == bench)
        body.append(f'<h2>{html.escape(bench)}</h2><div class="plots">{plots}</div>')
    return ('<!doctype html><html lang="en"><meta charset="utf-8"><title>History of the benchmarks</title>'
            f"<style>{STYLE}</style><body>{''.join(body)}</body></html>\n")
