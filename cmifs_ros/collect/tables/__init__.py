# SPDX-License-Identifier: Apache-2.0

"""Recordings that are no bags: tables (Parquet, CSV, data frames) and HDF5."""
