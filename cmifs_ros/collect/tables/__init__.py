# SPDX-License-Identifier: Apache-2.0

"""Recordings other than bags: tables (Parquet, CSV, data frames) and HDF5."""
