"""What studies of many runs share: rows that are computed in workers, kept, resumed, printed, shown as a page and exported."""
