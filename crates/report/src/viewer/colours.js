// Colours and numbers of the viewer.

// Blue to yellow, lightness rising evenly (viridis).
const VIRIDIS = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];

/// States of the fabric, as the structure-solver numbers them.
export const STATES = [
    { name: "slack", colour: "#7b8794" },
    { name: "wrinkled", colour: "#e08a3c" },
    { name: "taut", colour: "#2f7fb8" },
];

const known = new Map();

/// A colour as three numbers from 0 to 1.
export function paint(hex) {
    if (!known.has(hex)) known.set(hex, [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255));
    return known.get(hex);
}

/// Colour of a value from 0 to 1.
export function scale(value) {
    const x = Math.min(Math.max(value, 0), 1) * (VIRIDIS.length - 1);
    const i = Math.min(Math.floor(x), VIRIDIS.length - 2);
    const [a, b] = [paint(VIRIDIS[i]), paint(VIRIDIS[i + 1])];
    return a.map((c, k) => c + (x - i) * (b[k] - c));
}

/// Three digits.
export function number(value) {
    return value === 0 ? "0" : String(Number(value.toPrecision(3)));
}
