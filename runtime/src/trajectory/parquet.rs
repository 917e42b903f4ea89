//! Parquet files without a detour through Arrow.

use std::io::{self, Write};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::data_type::{BoolType, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::record::Field;
use parquet::schema::types::{Type, TypePtr};

use super::format::seventeen_digits;
use super::{Cell, ColumnType, Table};

/// Writes a table as one row group; empty cells are null.
pub(super) fn write(table: &Table, out: &mut dyn Write) -> io::Result<()> {
    write_group(table, out).map_err(io::Error::other)
}

fn write_group(table: &Table, out: &mut dyn Write) -> Result<(), ParquetError> {
    // The writer needs its own `Send` sink.
    let mut bytes = Vec::new();
    let properties = Arc::new(WriterProperties::builder().build());
    let mut file = SerializedFileWriter::new(&mut bytes, schema(table)?, properties)?;
    let mut group = file.next_row_group()?;
    for (column, (_, kind)) in table.columns().iter().enumerate() {
        match kind {
            ColumnType::Integer => {
                column_of::<Int64Type, _>(&mut group, table, column, |cell| match cell {
                    Cell::Integer(i) => Some(i),
                    _ => None,
                })?;
            }
            ColumnType::Natural => {
                column_of::<Int64Type, _>(&mut group, table, column, |cell| match cell {
                    // Parquet keeps unsigned numbers by their bits.
                    Cell::Natural(n) => Some(n.cast_signed()),
                    _ => None,
                })?;
            }
            ColumnType::Number => {
                column_of::<DoubleType, _>(&mut group, table, column, |cell| match cell {
                    Cell::Number(x) => Some(x),
                    _ => None,
                })?;
            }
            ColumnType::Text => {
                column_of::<ByteArrayType, _>(&mut group, table, column, |cell| match cell {
                    Cell::Text(_) => Some(table.text_of(cell).as_bytes().to_vec().into()),
                    _ => None,
                })?;
            }
            ColumnType::Flag => {
                column_of::<BoolType, _>(&mut group, table, column, |cell| match cell {
                    Cell::Flag(b) => Some(b),
                    _ => None,
                })?;
            }
        }
    }
    group.close()?;
    file.close()?;
    out.write_all(&bytes)?;
    Ok(())
}

/// Names of the columns, and the cells of every row as CSV has them: nothing for null, numbers with
/// all their digits.
///
/// # Errors
/// In words, what cannot be read.
pub(super) fn read(file: std::fs::File) -> Result<(Vec<String>, Vec<Vec<String>>), String> {
    let unread = |error: ParquetError| format!("the file cannot be read as Parquet: {error}");
    let reader = SerializedFileReader::new(file).map_err(unread)?;
    let schema = reader.metadata().file_metadata().schema();
    let names = schema.get_fields().iter().map(|field| field.name().to_owned()).collect();
    for column in reader.metadata().row_groups().iter().flat_map(|group| group.columns()) {
        if column.compression() != Compression::UNCOMPRESSED {
            let way = column.compression().to_string();
            let method = way.split('(').next().unwrap_or_default();
            return Err(format!("the columns are compressed ({method}); write them without compression, in pandas `compression=None`"));
        }
    }
    let mut rows = Vec::new();
    for row in reader.get_row_iter(None).map_err(unread)? {
        let fields = row.map_err(unread)?.into_columns();
        rows.push(fields.into_iter().map(|(name, field)| text(&name, &field)).collect::<Result<_, _>>()?);
    }
    Ok((names, rows))
}

fn text(column: &str, field: &Field) -> Result<String, String> {
    let number = |x: f64| {
        let mut text = String::new();
        seventeen_digits(x, &mut text);
        text
    };
    Ok(match field {
        Field::Null => String::new(),
        Field::Double(x) => number(*x),
        Field::Float(x) => number(f64::from(*x)),
        Field::Str(text) => text.clone(),
        Field::Bytes(_) | Field::Group(_) | Field::ListInternal(_) | Field::MapInternal(_) => {
            return Err(format!("the column `{column}` holds neither numbers nor text"));
        }
        other => other.to_string(),
    })
}

fn column_of<D: DataType, F: Fn(Cell) -> Option<D::T>>(
    group: &mut SerializedRowGroupWriter<'_, &mut Vec<u8>>,
    table: &Table,
    column: usize,
    take: F,
) -> Result<(), ParquetError> {
    let cells: Vec<Option<D::T>> = (0..table.len()).map(|row| take(table.row(row)[column])).collect();
    let present: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<D::T> = cells.into_iter().flatten().collect();
    let Some(mut writer) = group.next_column()? else {
        return Err(ParquetError::General("more columns than the schema has".into()));
    };
    writer.typed::<D>().write_batch(&values, Some(&present), None)?;
    writer.close()
}

fn schema(table: &Table) -> Result<TypePtr, ParquetError> {
    let field = |(name, kind): &(String, ColumnType)| {
        let physical = match kind {
            ColumnType::Integer | ColumnType::Natural => PhysicalType::INT64,
            ColumnType::Number => PhysicalType::DOUBLE,
            ColumnType::Flag => PhysicalType::BOOLEAN,
            ColumnType::Text => PhysicalType::BYTE_ARRAY,
        };
        let logical = match kind {
            ColumnType::Text => Some(LogicalType::String),
            ColumnType::Natural => Some(LogicalType::integer(64, false)),
            _ => None,
        };
        let builder = Type::primitive_type_builder(name, physical).with_logical_type(logical);
        Ok(Arc::new(builder.with_repetition(Repetition::OPTIONAL).build()?))
    };
    let fields: Result<Vec<TypePtr>, ParquetError> = table.columns().iter().map(field).collect();
    Ok(Arc::new(Type::group_type_builder("trajectory").with_fields(fields?).build()?))
}
