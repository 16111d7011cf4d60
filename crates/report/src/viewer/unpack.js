// Decodes the field data of the page: base64 of a deflated stream of differences in time.

async function inflate(base64) {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
}

export async function unpack({ header, data }) {
    const bytes = await inflate(data);
    const view = new DataView(bytes.buffer);
    let at = 0;
    const indices = (count) => {
        const out = new Uint32Array(count);
        for (let i = 0; i < count; i++, at += 4) out[i] = view.getUint32(at, true);
        return out;
    };
    const triangles = indices(3 * header.triangles);
    const hem = indices(2 * header.hem);
    const cables = indices(2 * header.cables);
    const width = 3 * header.nodes;
    // For each stage and frame: positions as 16-bit numbers, then the fields as bytes.
    const stages = header.stages.map((stage) => {
        const frames = [];
        let before = null;
        for (let f = 0; f < stage.times.length; f++) {
            const positions = new Uint16Array(width);
            for (let i = 0; i < width; i++) {
                // Low bytes first, then high bytes: this compresses better.
                const change = bytes[at + i] | (bytes[at + width + i] << 8);
                positions[i] = change + (before ? before.positions[i] : 0);
            }
            at += 2 * width;
            const fields = header.fields.map((_, k) => {
                const values = new Uint8Array(header.triangles);
                for (let i = 0; i < values.length; i++) {
                    values[i] = bytes[at + i] + (before ? before.fields[k][i] : 0);
                }
                at += values.length;
                return values;
            });
            before = { positions, fields };
            frames.push(before);
        }
        return frames;
    });
    if (at !== bytes.length) throw new Error(`${bytes.length - at} bytes of field data are left over`);
    const { origin, extent } = header;
    return {
        header, triangles, hem, cables,
        positions(stage, frame, out) {
            const from = stages[stage][frame].positions;
            for (let i = 0; i < width; i++) out[i] = origin[i % 3] + (extent[i % 3] * from[i]) / 65535;
        },
        values: (stage, frame, field) => stages[stage][frame].fields[field],
    };
}
