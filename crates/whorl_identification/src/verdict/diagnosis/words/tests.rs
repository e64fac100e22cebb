use super::behind;

#[test]
fn a_plain_number_has_no_unit() {
    assert_eq!([behind("1"), behind("N m")], ["", " N m"]);
}
