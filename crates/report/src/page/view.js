// A page that follows a run reloads itself. Scroll position and 3-D view stay as the reader left them.
"use strict";
(() => {
    const seconds = Number(document.body.dataset.reload);
    const kept = history.state && history.state.view;
    const viewer = () => document.getElementById("canopy")?.viewer;
    const keep = () => {
        const v = viewer();
        const times = v && v.data.header.stages[v.stage].times;
        const view = { y: scrollY, open: [...document.querySelectorAll("details")].map((d) => d.open) };
        if (v) {
            view.canopy = {
                eye: v.camera.position.toArray(), target: v.controls.target.toArray(), stage: v.stage, field: v.field,
                last: v.frame === times.length - 1, newest: v.stage === v.data.header.stages.length - 1, frame: v.frame,
                lines: v.cables.visible, mesh: v.edges.visible, playing: v.playing,
            };
        }
        history.replaceState({ view }, "");
    };
    const restore = ({ y, open, canopy }) => {
        document.querySelectorAll("details").forEach((d, i) => { d.open = Boolean(open[i]); });
        scrollTo({ top: y, behavior: "instant" });
        const v = viewer();
        if (!v || !canopy) return;
        const choose = (part, value) => {
            const box = v.find(part);
            if (box.type === "checkbox") box.checked = value;
            else box.value = value;
            box.dispatchEvent(new Event("change"));
        };
        // Who looked at the newest shape sees the newest one again.
        const newest = canopy.newest && canopy.last;
        const stage = newest ? v.stage : Math.min(canopy.stage, v.data.header.stages.length - 1);
        choose("stage", stage);
        choose("field", canopy.field);
        choose("lines", canopy.lines);
        choose("mesh", canopy.mesh);
        if (!canopy.last) v.show(Math.min(canopy.frame, v.data.header.stages[stage].times.length - 1));
        v.camera.position.fromArray(canopy.eye);
        v.controls.target.fromArray(canopy.target);
        v.controls.update();
        v.render();
        if (canopy.playing) v.play();
    };
    // The viewer unpacks its data after the page is read.
    const when = (ready, action, left = 100) => {
        if (ready() || left === 0) action();
        else setTimeout(() => when(ready, action, left - 1), 20);
    };
    const ready = () => !["loading"].includes(document.getElementById("canopy")?.dataset.state);
    if (kept) {
        history.scrollRestoration = "manual";
        when(ready, () => restore(kept));
    }
    if (!seconds) return;
    // A pointer that turns the canopy is not interrupted.
    let held = false;
    addEventListener("pointerdown", () => { held = true; });
    addEventListener("pointerup", () => { held = false; });
    setInterval(() => {
        if (held || document.hidden) return;
        keep();
        location.reload();
    }, 1000 * seconds);
})();
