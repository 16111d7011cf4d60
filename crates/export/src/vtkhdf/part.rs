//! A part of a time step: the cells of one file, or those of them within a box.

use mesh::vtk::read::{Column, Number, Piece};

/// A box with edges along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cuboid {
    low: [f64; 3],
    high: [f64; 3],
}

impl Cuboid {
    /// Reads `x0,y0,z0,x1,y1,z1`, m.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
        let numbers = numbers.ok().filter(|n| n.iter().all(|x| x.is_finite()));
        let six = numbers.and_then(|n| <[f64; 6]>::try_from(n).ok());
        let [x0, y0, z0, x1, y1, z1] =
            six.ok_or("expected six coordinates in metres, x0,y0,z0,x1,y1,z1, such as -5,-5,-10,5,5,10")?;
        let this = Self { low: [x0, y0, z0], high: [x1, y1, z1] };
        if (0..3).all(|c| this.low[c] < this.high[c]) {
            Ok(this)
        } else {
            Err("the first corner must lie below the second in x, y and z".into())
        }
    }

    fn contains(&self, point: [f64; 3]) -> bool {
        (0..3).all(|c| (self.low[c]..=self.high[c]).contains(&point[c]))
    }
}

/// Which cells have which nodes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Topology {
    pub(super) points: usize,
    pub(super) connectivity: Vec<i64>,
    /// Ends of the cells in `connectivity`, with 0 first.
    pub(super) offsets: Vec<i64>,
    /// As VTK numbers them.
    pub(super) types: Vec<u8>,
}

/// Numbers in the type that their file has.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Numbers {
    F64(Vec<f64>),
    F32(Vec<f32>),
    U32(Vec<u32>),
}

/// A field.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) width: usize,
    pub(super) numbers: Numbers,
}

impl Field {
    /// The rows `rows` of a column.
    fn of(column: &Column, rows: &[usize]) -> Self {
        let values = rows.iter().flat_map(|&r| &column.values[r * column.width..(r + 1) * column.width]);
        let numbers = match column.number {
            Number::F64 => Numbers::F64(values.copied().collect()),
            Number::F32 => Numbers::F32(values.map(|v| *v as f32).collect()),
            Number::U32 => Numbers::U32(values.map(|v| *v as u32).collect()),
        };
        Self { name: column.name.clone(), width: column.width, numbers }
    }
}

/// A part.
#[derive(Clone, Debug, Default)]
pub(super) struct Part {
    pub(super) topology: Topology,
    /// Positions, m.
    pub(super) points: Vec<[f64; 3]>,
    pub(super) point_fields: Vec<Field>,
    pub(super) cell_fields: Vec<Field>,
}

impl Part {
    /// The cells of `piece` whose mean of nodes lies within a box, with their points and the fields that `wanted`
    /// accepts.
    pub(super) fn of(piece: &Piece, within: Option<&Cuboid>, wanted: impl Fn(&str) -> bool) -> Self {
        let inside = |&cell: &usize| {
            within.is_none_or(|cuboid| {
                let nodes = piece.cell(cell);
                let mean = |c: usize| {
                    nodes.iter().map(|&n| piece.points[n as usize][c]).sum::<f64>() / nodes.len() as f64
                };
                cuboid.contains([mean(0), mean(1), mean(2)])
            })
        };
        let cells: Vec<usize> = (0..piece.n_cells()).filter(inside).collect();
        let mut points: Vec<usize> = match within {
            // Also points without a cell.
            None => (0..piece.points.len()).collect(),
            Some(_) => cells.iter().flat_map(|&c| piece.cell(c)).map(|&n| n as usize).collect(),
        };
        points.sort_unstable();
        points.dedup();
        let mut number = vec![0; piece.points.len()];
        points.iter().zip(0..).for_each(|(&p, i)| number[p] = i);
        let mut topology = Topology { points: points.len(), offsets: vec![0], ..Topology::default() };
        for &cell in &cells {
            topology.connectivity.extend(piece.cell(cell).iter().map(|&n| number[n as usize]));
            topology.offsets.push(topology.connectivity.len() as i64);
            topology.types.push(piece.vtk_type(cell));
        }
        let fields = |columns: &[Column], rows: &[usize]| {
            columns.iter().filter(|c| wanted(&c.name)).map(|c| Field::of(c, rows)).collect()
        };
        Self {
            topology,
            point_fields: fields(&piece.point_fields, &points),
            cell_fields: fields(&piece.cell_fields, &cells),
            points: points.iter().map(|&p| piece.points[p]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::vtk::{Values, write_volume};
    use mesh::{BoxShape, Patch, box_grid_of};

    #[test]
    fn a_box_keeps_the_cells_whose_centre_lies_inside() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("flow.vtu");
        let grid = box_grid_of(BoxShape::Hexahedra, [4; 3], [0.0; 3], [4.0; 3], [Patch::Wall; 6]);
        let number: Vec<u32> = (0..grid.cells.len() as u32).collect();
        let height: Vec<f64> = grid.coords.iter().map(|p| p[2]).collect();
        let (cells, points) = ([("cell", Values::U32(&number))], [("z", Values::F64(&height))]);
        write_volume(&file, &grid.coords, &grid.cells, &points, &cells).unwrap();
        let piece = Piece::read(&file).unwrap();
        let whole = Part::of(&piece, None, |_| true);
        assert_eq!((whole.topology.types.len(), whole.points.len()), (64, 125));
        assert_eq!(whole.cell_fields[0].numbers, Numbers::U32(number));
        // Two cells in x, one in y, four in z.
        let some = Part::of(&piece, Some(&Cuboid::parse("0,1.1,0,2,2.4,4").unwrap()), |name| name == "z");
        assert_eq!((some.topology.types.len(), some.points.len(), some.cell_fields.len()), (8, 30, 0));
        let Numbers::F64(z) = &some.point_fields[0].numbers else { panic!("not in double precision") };
        for cell in 0..8 {
            let nodes = &some.topology.connectivity[8 * cell..8 * cell + 8];
            let centre: f64 = nodes.iter().map(|&n| some.points[n as usize][1]).sum();
            assert_eq!(centre / 8.0, 1.5);
            assert!(nodes.iter().all(|&n| z[n as usize] == some.points[n as usize][2]));
        }
    }

    #[test]
    fn corners_of_a_box_are_checked() {
        assert!(Cuboid::parse("-1, -1, -1, 1, 1, 1").is_ok());
        for text in ["1,2,3", "a,0,0,1,1,1", "0,0,0,1,1,nan", "0,0,0,1,-1,1"] {
            assert!(Cuboid::parse(text).is_err(), "{text}");
        }
    }
}
