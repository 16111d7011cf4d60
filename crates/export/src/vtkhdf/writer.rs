//! A VTKHDF file (version 2.0) of an unstructured grid over time.
//!
//! Each array holds the values of all steps one after the other; `Steps` says where those of a step begin. A step whose
//! cells or positions are those of the step before refers to them.

use std::mem::{Discriminant, discriminant};
use std::path::Path;

use rust_hdf5::{DatatypeMessage, H5File, H5Group};

use super::growing::Growing;
use super::part::{Field, Numbers, Part, Topology};

/// Version of the format: the first with time steps, so that each reader of them reads it.
const VERSION: [i64; 2] = [2, 0];

/// Datasets of one field: its values, and the row at which each step begins.
struct FieldData {
    name: String,
    width: usize,
    number: Discriminant<Numbers>,
    values: Growing,
    begins: Growing,
}

/// Fields of points or of cells.
type Fields = Vec<FieldData>;

/// Rows at which the step before begins, and what it holds.
struct Last {
    part: i64,
    point: i64,
    cell: i64,
    connectivity: i64,
    topologies: Vec<Topology>,
    points: Vec<Vec<[f64; 3]>>,
}

/// A growing file.
pub(super) struct Writer {
    file: H5File,
    steps: H5Group,
    /// Points, cells and nodes of cells of each part.
    counts: [Growing; 3],
    points: Growing,
    connectivity: Growing,
    offsets: Growing,
    types: Growing,
    times: Growing,
    /// First part of each step, its number of parts, and its first point, cell and node of a cell.
    begins: [Growing; 5],
    point_fields: Fields,
    cell_fields: Fields,
    last: Option<Last>,
    n_steps: i64,
}

/// Why a step was not written.
#[derive(Debug)]
pub(super) enum WriteError {
    /// The library reports an error.
    Hdf5(rust_hdf5::Hdf5Error),
    /// A field of the first step is not in this one, or has another width or type.
    Missing(String),
}

impl From<rust_hdf5::Hdf5Error> for WriteError {
    fn from(error: rust_hdf5::Hdf5Error) -> Self {
        Self::Hdf5(error)
    }
}

impl Writer {
    /// A new file with the fields and sizes of its first step; `source` says what wrote it.
    pub(super) fn create(path: &Path, source: &str, first: &[Part]) -> rust_hdf5::Result<Self> {
        let file = H5File::create(path)?;
        file.set_attr_string("source", source)?;
        let root = file.create_group("VTKHDF")?;
        root.set_attr_array_numeric("Version", &VERSION)?;
        // Of fixed length: older readers refuse others.
        let kind = b"UnstructuredGrid".to_vec();
        root.set_attr_typed("Type", DatatypeMessage::fixed_string(kind.len() as u32), kind)?;
        let steps = root.create_group("Steps")?;
        let rows = |of: fn(&Part) -> usize| first.iter().map(of).sum::<usize>();
        let (n_points, n_cells) = (rows(|p| p.points.len()), rows(|p| p.topology.types.len()));
        let whole = |group: &H5Group, name: &str| Growing::new::<i64>(group, name, 1, 0);
        let fields = |name: &str, of: fn(&Part) -> &Vec<Field>, rows: usize| -> rust_hdf5::Result<Fields> {
            let values = root.create_group(&format!("{name}Data"))?;
            let begins = steps.create_group(&format!("{name}DataOffsets"))?;
            let some = first.first().map(of).into_iter().flatten();
            some.map(|f| FieldData::new(f, &values, &begins, rows)).collect()
        };
        Ok(Self {
            counts: [
                whole(&root, "NumberOfPoints")?,
                whole(&root, "NumberOfCells")?,
                whole(&root, "NumberOfConnectivityIds")?,
            ],
            points: Growing::new::<f64>(&root, "Points", 3, n_points)?,
            connectivity: Growing::new::<i64>(
                &root,
                "Connectivity",
                1,
                rows(|p| p.topology.connectivity.len()),
            )?,
            offsets: Growing::new::<i64>(&root, "Offsets", 1, n_cells + first.len())?,
            types: Growing::new::<u8>(&root, "Types", 1, n_cells)?,
            times: Growing::new::<f64>(&steps, "Values", 1, 0)?,
            begins: [
                whole(&steps, "PartOffsets")?,
                whole(&steps, "NumberOfParts")?,
                whole(&steps, "PointOffsets")?,
                whole(&steps, "CellOffsets")?,
                whole(&steps, "ConnectivityIdOffsets")?,
            ],
            point_fields: fields("Point", |p| &p.point_fields, n_points)?,
            cell_fields: fields("Cell", |p| &p.cell_fields, n_cells)?,
            last: None,
            n_steps: 0,
            file,
            steps,
        })
    }

    /// Adds a step at `time` (s).
    pub(super) fn add(&mut self, time: f64, parts: Vec<Part>) -> Result<(), WriteError> {
        for (fields, of) in [
            (&mut self.point_fields, (|p| &p.point_fields) as fn(&Part) -> &Vec<Field>),
            (&mut self.cell_fields, |p| &p.cell_fields),
        ] {
            for field in fields {
                field.add(parts.iter().map(of))?;
            }
        }
        let last = self.geometry(parts)?;
        self.times.append(&[time])?;
        let n_parts = last.topologies.len() as i64;
        for (begin, at) in
            self.begins.iter_mut().zip([last.part, n_parts, last.point, last.cell, last.connectivity])
        {
            begin.append(&[at])?;
        }
        self.last = Some(last);
        self.n_steps += 1;
        Ok(())
    }

    /// Writes cells and positions that differ from those of the step before.
    fn geometry(&mut self, parts: Vec<Part>) -> rust_hdf5::Result<Last> {
        let (topologies, points): (Vec<_>, Vec<_>) =
            parts.into_iter().map(|p| (p.topology, p.points)).unzip();
        let kept = self.last.take();
        let same_cells = kept.as_ref().filter(|l| l.topologies == topologies);
        let (part, cell, connectivity) = match same_cells {
            Some(l) => (l.part, l.cell, l.connectivity),
            None => {
                let begin = (self.counts[0].rows(), self.types.rows(), self.connectivity.rows());
                for t in &topologies {
                    let counts = [t.points, t.types.len(), t.connectivity.len()];
                    for (all, count) in self.counts.iter_mut().zip(counts) {
                        all.append(&[count as i64])?;
                    }
                    self.connectivity.append(&t.connectivity)?;
                    self.offsets.append(&t.offsets)?;
                    self.types.append(&t.types)?;
                }
                (begin.0 as i64, begin.1 as i64, begin.2 as i64)
            }
        };
        let point = match kept.as_ref().filter(|l| l.points == points) {
            Some(l) => l.point,
            None => {
                let begin = self.points.rows() as i64;
                for positions in &points {
                    self.points.append(positions.as_flattened())?;
                }
                begin
            }
        };
        Ok(Last { part, point, cell, connectivity, topologies, points })
    }

    /// Writes what waits and closes the file.
    pub(super) fn finish(self) -> rust_hdf5::Result<()> {
        self.steps.set_attr_numeric("NSteps", &self.n_steps)?;
        let arrays = [self.points, self.connectivity, self.offsets, self.types, self.times];
        let fields = self.point_fields.into_iter().chain(self.cell_fields).flat_map(|f| [f.values, f.begins]);
        arrays
            .into_iter()
            .chain(self.counts)
            .chain(self.begins)
            .chain(fields)
            .try_for_each(Growing::finish)?;
        self.file.close()
    }
}

impl FieldData {
    fn new(field: &Field, values: &H5Group, begins: &H5Group, rows: usize) -> rust_hdf5::Result<Self> {
        let (name, width) = (field.name.clone(), field.width);
        let values = match field.numbers {
            Numbers::F64(_) => Growing::new::<f64>(values, &name, width, rows),
            Numbers::F32(_) => Growing::new::<f32>(values, &name, width, rows),
            Numbers::U32(_) => Growing::new::<u32>(values, &name, width, rows),
        }?;
        let begins = Growing::new::<i64>(begins, &name, 1, 0)?;
        Ok(Self { name, width, number: discriminant(&field.numbers), values, begins })
    }

    /// Appends the values of a step, from the fields of each part.
    fn add<'a>(&mut self, parts: impl Iterator<Item = &'a Vec<Field>>) -> Result<(), WriteError> {
        self.begins.append(&[self.values.rows() as i64])?;
        for fields in parts {
            let same = |f: &&Field| {
                (&f.name, f.width, discriminant(&f.numbers)) == (&self.name, self.width, self.number)
            };
            let found = fields.iter().find(same);
            let found = found.ok_or_else(|| WriteError::Missing(self.name.clone()))?;
            match &found.numbers {
                Numbers::F64(v) => self.values.append(v),
                Numbers::F32(v) => self.values.append(v),
                Numbers::U32(v) => self.values.append(v),
            }?;
        }
        Ok(())
    }
}
