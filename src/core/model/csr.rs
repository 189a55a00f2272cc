//! Lists of lists in one piece of memory: for each key, the items that belong to it.

/// Items by key, (n_keys) lists.
#[derive(Clone, Debug, Default)]
pub struct Csr<Item> {
    start: Vec<u32>,
    items: Vec<Item>,
}

impl<Item: Copy + Default> Csr<Item> {
    /// From (key, item) pairs, read twice; items of a key keep their order.
    pub fn new(keys: usize, pairs: impl Iterator<Item = (usize, Item)> + Clone) -> Self {
        let mut start = vec![0u32; keys + 1];
        for (key, _) in pairs.clone() {
            start[key + 1] += 1;
        }
        for k in 0..keys {
            start[k + 1] += start[k];
        }
        let mut next = start.clone();
        let mut items = vec![Item::default(); start[keys] as usize];
        for (key, item) in pairs {
            items[next[key] as usize] = item;
            next[key] += 1;
        }
        Self { start, items }
    }

    /// The items of `key`.
    pub fn of(&self, key: usize) -> &[Item] {
        &self.items[self.start_of(key)..self.start[key + 1] as usize]
    }

    /// Number of the first item of `key` among all.
    pub fn start_of(&self, key: usize) -> usize {
        self.start[key] as usize
    }
}
