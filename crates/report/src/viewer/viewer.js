// Interactive 3-D view of the canopy over time. Reads the data in the page.
import {
    AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, Color, ColorManagement, DirectionalLight, DoubleSide,
    EdgesGeometry, Group, LinearSRGBColorSpace, LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial, PerspectiveCamera,
    Raycaster, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { unpack } from "./unpack.js";
import { STATES, number, paint, scale } from "./colours.js";

// Colours of the page are what the legend shows: no conversion on the way.
ColorManagement.enabled = false;

const FRAMES_PER_SECOND = 20;

class Viewer {
    constructor(root, data) {
        this.root = root;
        this.data = data;
        this.stage = data.header.stages.length - 1;
        this.field = 0;
        this.frame = 0;
        this.playing = false;
        this.find = (name) => root.querySelector(`[data-part="${name}"]`);
        this.build();
        this.connect();
        this.resize();
        this.reset();
        this.open(this.stage);
    }

    build() {
        const { header, triangles, cables, hem } = this.data;
        this.canvas = this.find("canvas");
        this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
        this.renderer.outputColorSpace = LinearSRGBColorSpace;
        this.scene = new Scene();
        this.camera = new PerspectiveCamera(32, 1, 0.01, 1e4);
        this.camera.up.set(0, 0, 1);
        this.scene.add(new AmbientLight(0xffffff, 1.9));
        const sun = new DirectionalLight(0xffffff, 1.6);
        sun.position.set(-0.4, 0.7, 1);
        this.camera.add(sun);
        this.scene.add(this.camera);

        // Each triangle has corners of its own, so that it can show a state that its neighbours do not share.
        const corners = triangles.length;
        const fabric = new BufferGeometry();
        for (const name of ["position", "normal", "color"]) {
            fabric.setAttribute(name, new BufferAttribute(new Float32Array(3 * corners), 3));
        }
        this.fabric = new Mesh(fabric, new MeshLambertMaterial({ vertexColors: true, side: DoubleSide }));
        this.fabric.frustumCulled = false;
        const lines = (ends) => {
            const shape = new BufferGeometry();
            shape.setAttribute("position", new BufferAttribute(new Float32Array(3 * ends.length), 3));
            const made = new LineSegments(shape, new LineBasicMaterial());
            made.frustumCulled = false;
            return made;
        };
        this.hem = lines(hem);
        this.cables = lines(cables);
        this.edges = lines(new Uint32Array(2 * corners));
        this.edges.material.transparent = true;
        this.edges.material.opacity = 0.25;
        this.edges.visible = false;
        this.scene.add(this.fabric, this.hem, this.cables, this.edges);
        this.payload = new Group();
        this.outlines = [this.hem, this.cables, this.edges];
        if (header.payload) {
            const box = new BoxGeometry(...header.payload.size);
            const sides = new LineSegments(new EdgesGeometry(box), new LineBasicMaterial());
            this.payload.add(new Mesh(box, new MeshLambertMaterial({ color: 0x9aa4ae })), sides);
            this.outlines.push(sides);
        }
        this.scene.add(this.payload);
        this.points = new Float32Array(3 * header.nodes);
        this.normals = new Float32Array(3 * header.nodes);
        this.smooth = new Float32Array(header.nodes);
        this.weights = new Float32Array(header.nodes);

        this.controls = new OrbitControls(this.camera, this.canvas);
        this.controls.addEventListener("change", () => this.render());
        const choose = (select, names) => names.forEach((name, i) => select.add(new Option(name, i)));
        choose(this.find("stage"), header.stages.map((s) => s.name));
        choose(this.find("field"), header.fields.map((f) => f.label));
        this.find("stage").value = this.stage;
    }

    connect() {
        const on = (name, event, action) => this.find(name).addEventListener(event, action);
        on("stage", "change", (e) => this.open(Number(e.target.value)));
        on("field", "change", (e) => this.colour(Number(e.target.value)));
        on("time", "input", (e) => { this.pause(); this.show(Number(e.target.value)); });
        on("play", "click", () => (this.playing ? this.pause() : this.play()));
        on("reset", "click", () => this.reset());
        on("lines", "change", (e) => { this.cables.visible = e.target.checked; this.show(this.frame); });
        on("mesh", "change", (e) => { this.edges.visible = e.target.checked; this.show(this.frame); });
        this.canvas.addEventListener("pointermove", (e) => this.probe(e));
        this.canvas.addEventListener("pointerleave", () => { this.find("value").textContent = ""; });
        new ResizeObserver(() => { this.resize(); this.render(); }).observe(this.canvas.parentElement);
        matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.ink(); this.render(); });
        this.ink();
    }

    // Lines take the page's own ink, light or dark.
    ink() {
        const style = getComputedStyle(this.root);
        const ink = new Color(style.getPropertyValue("--ink").trim() || "#222");
        for (const lines of this.outlines) lines.material.color = ink;
    }

    resize() {
        const { clientWidth, clientHeight } = this.canvas.parentElement;
        this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
        this.renderer.setSize(clientWidth, clientHeight, false);
        this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
        this.camera.updateProjectionMatrix();
    }

    // The view from the side and a little below, with everything that ever moves in it.
    reset() {
        const { origin, extent } = this.data.header;
        const centre = new Vector3(...origin.map((o, i) => o + extent[i] / 2));
        const radius = Math.hypot(...extent) / 2;
        const narrow = Math.min(1, this.camera.aspect);
        const distance = (0.8 * radius) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
        this.camera.near = 0.02 * radius;
        this.camera.far = 20 * distance;
        this.camera.updateProjectionMatrix();
        this.camera.position.copy(centre).add(new Vector3(0.85, 0.48, -0.2).normalize().multiplyScalar(distance));
        this.controls.target.copy(centre);
        this.controls.update();
        this.render();
    }

    open(stage) {
        this.pause();
        this.stage = stage;
        const last = this.data.header.stages[stage].times.length - 1;
        const slider = this.find("time");
        slider.max = last;
        this.find("play").disabled = last < 1;
        this.show(last);
        this.legend();
    }

    colour(field) {
        this.field = field;
        this.show(this.frame);
        this.legend();
    }

    play() {
        this.playing = true;
        this.find("play").textContent = "Pause";
        let before = performance.now();
        let due = 0;
        const tick = (now) => {
            if (!this.playing) return;
            due += ((now - before) / 1000) * FRAMES_PER_SECOND;
            before = now;
            if (due >= 1) {
                const count = this.data.header.stages[this.stage].times.length;
                this.show((this.frame + Math.floor(due)) % count);
                due %= 1;
            }
            requestAnimationFrame(tick);
        };
        requestAnimationFrame(tick);
    }

    pause() {
        this.playing = false;
        this.find("play").textContent = "Play";
    }

    show(frame) {
        this.frame = frame;
        const { header, triangles, cables, hem } = this.data;
        const stage = header.stages[this.stage];
        this.data.positions(this.stage, frame, this.points);
        const points = this.points;
        const gather = (lines, ends) => {
            const to = lines.geometry.attributes.position;
            for (let i = 0; i < ends.length; i++) {
                for (let c = 0; c < 3; c++) to.array[3 * i + c] = points[3 * ends[i] + c];
            }
            to.needsUpdate = true;
        };
        gather(this.fabric, triangles);
        gather(this.hem, hem);
        gather(this.cables, cables);
        // Place and attitude (a quaternion, scalar part last) of the payload, shown with its lines.
        const pose = stage.payload?.[frame];
        this.payload.visible = Boolean(pose) && this.cables.visible;
        if (pose) {
            this.payload.position.set(...pose.slice(0, 3));
            this.payload.quaternion.set(...pose.slice(3));
        }
        if (this.edges.visible) this.outline();
        this.shade();
        this.paint();
        this.find("time").value = frame;
        const text = `${stage.times[frame].toFixed(3)} s`;
        this.find("clock").textContent = text;
        this.find("time").setAttribute("aria-valuetext", text);
        this.render();
    }

    outline() {
        const to = this.edges.geometry.attributes.position;
        const from = this.fabric.geometry.attributes.position.array;
        for (let t = 0, at = 0; t < from.length; t += 9) {
            for (const [a, b] of [[0, 3], [3, 6], [6, 0]]) {
                for (let c = 0; c < 3; c++) to.array[at++] = from[t + a + c];
                for (let c = 0; c < 3; c++) to.array[at++] = from[t + b + c];
            }
        }
        to.needsUpdate = true;
    }

    // Normals of the nodes, from the triangles around them by their areas.
    shade() {
        const { triangles } = this.data;
        const { points: p, normals: n } = this;
        n.fill(0);
        for (let t = 0; t < triangles.length; t += 3) {
            const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
            const [ux, uy, uz] = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
            const [vx, vy, vz] = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
            const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
            for (const i of [a, b, c]) { n[i] += x; n[i + 1] += y; n[i + 2] += z; }
        }
        const to = this.fabric.geometry.attributes.normal;
        for (let i = 0; i < triangles.length; i++) {
            const at = 3 * triangles[i];
            const length = Math.hypot(n[at], n[at + 1], n[at + 2]) || 1;
            for (let c = 0; c < 3; c++) to.array[3 * i + c] = n[at + c] / length;
        }
        to.needsUpdate = true;
    }

    paint() {
        const { header, triangles } = this.data;
        const field = header.fields[this.field];
        const values = this.data.values(this.stage, this.frame, this.field);
        const to = this.fabric.geometry.attributes.color;
        if (field.kind === "states") {
            for (let i = 0; i < triangles.length; i++) {
                to.array.set(paint(STATES[Math.min(values[(i / 3) | 0], 2)].colour), 3 * i);
            }
        } else {
            // Means of the triangles around a node, so that colours run smoothly.
            const { smooth, weights } = this;
            smooth.fill(0);
            weights.fill(0);
            for (let i = 0; i < triangles.length; i++) {
                smooth[triangles[i]] += values[(i / 3) | 0];
                weights[triangles[i]] += 1;
            }
            for (let i = 0; i < triangles.length; i++) {
                const node = triangles[i];
                to.array.set(scale(smooth[node] / weights[node] / 255), 3 * i);
            }
        }
        to.needsUpdate = true;
    }

    legend() {
        const field = this.data.header.fields[this.field];
        const range = this.data.header.stages[this.stage].ranges[this.field];
        const box = this.find("legend");
        box.replaceChildren();
        const add = (tag, className, text) => {
            const made = document.createElement(tag);
            made.className = className;
            made.textContent = text;
            box.append(made);
            return made;
        };
        if (field.kind === "states") {
            for (const state of STATES) {
                add("span", "swatch", "").style.background = state.colour;
                add("span", "", state.name);
            }
        } else {
            add("span", "", `${number(range[0])} ${field.unit}`);
            const steps = Array.from({ length: 9 }, (_, i) => `rgb(${scale(i / 8).map((c) => Math.round(255 * c))})`);
            add("span", "ramp", "").style.background = `linear-gradient(to right, ${steps.join(",")})`;
            add("span", "", `${number(range[1])} ${field.unit}`);
        }
        this.find("note").textContent = field.note;
    }

    // The value under the pointer.
    probe(event) {
        if (event.buttons || this.playing) return;
        const box = this.canvas.getBoundingClientRect();
        const at = new Vector2(
            (2 * (event.clientX - box.left)) / box.width - 1,
            1 - (2 * (event.clientY - box.top)) / box.height,
        );
        const ray = new Raycaster();
        ray.setFromCamera(at, this.camera);
        this.fabric.geometry.computeBoundingSphere();
        const hit = ray.intersectObject(this.fabric)[0];
        const field = this.data.header.fields[this.field];
        let text = "";
        if (hit) {
            const value = this.data.values(this.stage, this.frame, this.field)[(hit.face.a / 3) | 0];
            const range = this.data.header.stages[this.stage].ranges[this.field];
            text = field.kind === "states"
                ? STATES[Math.min(value, 2)].name
                : `${field.label} ${number(range[0] + (value / 255) * (range[1] - range[0]))} ${field.unit}`;
        }
        this.find("value").textContent = text;
    }

    render() {
        this.renderer.render(this.scene, this.camera);
    }
}

async function start() {
    const root = document.getElementById("canopy");
    const packed = document.getElementById("canopy-data");
    if (!root || !packed) return;
    try {
        root.viewer = new Viewer(root, await unpack(JSON.parse(packed.textContent)));
        root.dataset.state = "ready";
    } catch (error) {
        // Without WebGL the still picture is shown.
        root.dataset.state = "failed";
        root.querySelector('[data-part="trouble"]').textContent = `The 3-D view needs WebGL 2 (${error.message}).`;
    }
}

start();
