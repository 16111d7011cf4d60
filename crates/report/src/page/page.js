// Shows the values of the curves at the pointer, or at the position set with the left and right keys.
"use strict";
for (const svg of document.querySelectorAll("svg.chart")) {
    const [left, top, width, height] = svg.dataset.box.split(",").map(Number);
    const [x0, x1, y0, y1] = svg.dataset.span.split(",").map(Number);
    const unit = svg.dataset.unit;
    // Drawing units per pixel.
    const pixel = Number(svg.dataset.pixel);
    const curves = [...svg.querySelectorAll(".curve[data-points]")].map((path) => ({
        label: path.dataset.label,
        style: path.getAttribute("class").split(" ")[1].replace("c", "f"),
        points: path.dataset.points.split(";").filter(Boolean).map((p) => p.split(",").map(Number)),
    }));
    const make = (tag, attributes, text = "") => {
        const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
        for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
        made.textContent = text;
        return made;
    };
    const marks = make("g", { class: "marks" });
    svg.append(marks);
    let at = null;
    const nearest = (points, x) => {
        let low = 0;
        let high = points.length - 1;
        while (high - low > 1) {
            const middle = (low + high) >> 1;
            if (points[middle][0] < x) low = middle;
            else high = middle;
        }
        return x - points[low][0] < points[high][0] - x ? low : high;
    };
    const show = (x) => {
        at = Math.min(Math.max(x, x0), x1);
        const px = left + (width * (at - x0)) / (x1 - x0);
        const right = px > left + width * 0.6;
        marks.replaceChildren(make("path", { class: "guide", "stroke-width": pixel, d: `M${px} ${top}v${height}` }));
        const write = (line, text) => marks.append(make("text", {
            class: "tip", x: px + (right ? -9 : 9) * pixel, y: top + (14 + 16 * line) * pixel,
            "font-size": 12 * pixel, "stroke-width": 4 * pixel, "text-anchor": right ? "end" : "start",
        }, text));
        write(0, `${at.toPrecision(4)} s`);
        curves.forEach((curve, i) => {
            if (!curve.points.length) return;
            const [, y] = curve.points[nearest(curve.points, at)];
            const v = svg.dataset.log ? Math.log10(Math.max(y, 1e-300)) : y;
            const py = top + height * (1 - (v - y0) / (y1 - y0));
            marks.append(make("circle", { class: `dot ${curve.style}`, cx: px, cy: py, r: 4 * pixel, "stroke-width": 1.5 * pixel }));
            write(i + 1, `${curves.length > 1 ? curve.label + " " : ""}${y} ${unit}`);
        });
    };
    const hide = () => { at = null; marks.replaceChildren(); };
    svg.addEventListener("pointermove", (event) => {
        const box = svg.getBoundingClientRect();
        const px = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
        show(x0 + ((px - left) / width) * (x1 - x0));
    });
    svg.addEventListener("pointerleave", hide);
    svg.addEventListener("blur", hide);
    svg.addEventListener("keydown", (event) => {
        const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (!step) return;
        event.preventDefault();
        show((at ?? x0) + (step * (x1 - x0)) / 100);
    });
}
