//! The memory of the rig: a map of records, and the write in progress.

use hal_sim::world::Write;
use protocol_core::memory::{Image, Record, RecordKey, StoreError};

use super::Rig;

impl Rig {
    /// Returns the memory that a start finds.
    pub(super) fn image(&self) -> Image {
        let mut image = Image::empty();
        for (key, record) in &self.records {
            image.put(*key, record);
        }
        if self.memory_damaged {
            image.set_damaged();
        }
        image
    }

    pub(super) fn begin_write(&mut self, key: RecordKey, record: Record) {
        assert!(self.write.is_none(), "two writes at once");
        self.write = Some(Write::begin(key, record, self.now, self.write_time));
    }

    /// Ends the write that is due, and reports its result to the device.
    pub(super) fn finish_write(&mut self) {
        let now = self.now;
        let Some(write) = self.write.take_if(|write| write.done <= now) else { return };
        let fails = self.failing_writes.remove(&0) || self.writes_fail;
        self.failing_writes = self.failing_writes.iter().map(|number| number - 1).collect();
        if !fails {
            self.records.insert(write.key, write.record.to_vec());
            self.writes.push(write.key);
        }
        self.device.as_dyn_mut().stored(write.key, if fails { Err(StoreError) } else { Ok(()) }, now);
    }
}
