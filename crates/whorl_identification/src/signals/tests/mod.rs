mod digits;
mod readings;
mod seen;
